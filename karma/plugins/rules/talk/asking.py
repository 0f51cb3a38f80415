"""What a question asks about: its words, the things in it, and which of them are places."""

import re
from collections.abc import Iterator
from dataclasses import replace

from karma.assistant.session_log import CLOCK_START_S
from karma.household.types import object_types
from karma.plugins.rules.language.clock import read_span, unread_times
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.talk.remembering import Remembering
from karma.plugins.rules.types import Mention, Request

ASKING = ("where", "when", "how", "who", "what", "which", "whose", "why")
_LEADS = re.compile(
    r"^(?:(?:and|so|hey|but|now|then)[, ]+)+|(?:(?:can|could|would) you )?tell me |^do you know "
)
_DETERMINERS = (
    r"(?:(?:the|my|your|our|his|her|their|this|that|these|those|a|an|any|all|one|each|both|some|of)"
    r"\s+)*"
)
_IN = r"in|inside|into|within|on|onto|at|from|out of"
_BESIDE = r"under|underneath|below|beneath|near|by|beside|next to|close to|around"
_AT = re.compile(rf"\b(?:{_IN}|(?P<beside>{_BESIDE}))\s+{_DETERMINERS}$")
_HANGING = re.compile(rf"\b(?:{_IN})\W*$")
_IS_ON = re.compile(r"(?:\b(?:is|are|was|were|still|left)|'s) on\W*$")  # a state, no place
_HOLDS = re.compile(r"\s*(?:still )?(?:has|have|had|holds?|contains?)\b")
_OPEN = re.compile(r"\b(?:anything|something|everything|all|stuff|things?)\b")
_IT = frozenset(("it", "that", "this", "them", "there", "these", "those"))
_ITSELF = re.compile(r"\b(?:in|inside|on|under) (?:it|them)\b")


class AskedQuestion:
    """A question's words, and the things in it; `knows` is what it is answered from."""

    def __init__(self, request: Request, knows: Remembering, reader: RequestReader) -> None:
        self.knows, self.reader = knows, reader
        self.raw = request.text.lower().replace("’", "'")
        text = _LEADS.sub("", self.raw)
        self.words = re.findall(r"[a-z]+|'[a-z]+", text)
        self._span, self._rest = read_span(text, knows.now_s + CLOCK_START_S)
        self.asks = next((word for word in self.words[:4] if word in ASKING), "")
        self.first = self.words[0] if self.words else ""
        self.open = bool(_OPEN.search(self.raw))
        self.beside = False  # it asks beside or below those places, not in or on them
        self._places: list[str] = []  # the words by which they are said
        named = [self._as_here(one) for one in self._things_in(request)]
        at = [one for one in named if self._is_place(one)]
        self.at = at or self._whose_contents(named)  # "in the fridge", "which cabinet has ..."
        self.about = [one for one in named if one not in self.at]  # what something is asked of
        self.things = [*self.about, *self.at]
        self.unknown = [  # named things that nothing is called by
            one for one in request.alone if not (one.types or one.vague or _OPEN.search(one.text))
        ]

    def _things_in(self, request: Request) -> Iterator[Mention]:
        """Yield its things, without an "in it" of what it names itself."""
        alone = [one for one in request.alone if one.types]
        own = [
            one for one in alone
            if self.raw[max(one.start, 0) : max(one.end, 0)].strip() not in _IT
        ]  # fmt: skip
        itself = bool(_ITSELF.search(self.raw)) and any(map(can_hold, own))
        itself = itself and re.search(r"\bthere\b", self.raw) is None  # "is there a mug in it?"
        same = [
            one for one in alone
            if one not in own and any({*one.types} & {*two.types} for two in own)
        ]  # fmt: skip
        yield from own if itself else (one for one in alone if one not in same)

    def _as_here(self, one: Mention) -> Mention:
        """Return a thing as its word means it here: the arm chair where there is no chair."""
        here = {*self.knows.furniture, *(sight.object_type for sight, _ in self.knows.all())}
        lacks = one.besides and not here & {*one.types} and here & {*one.besides}
        return replace(one, types=one.besides) if lacks else one

    def _is_place(self, one: Mention) -> bool:
        """Return whether a thing is said as a place: "on the table"."""
        found = _AT.search(self.raw[: one.start]) if one.start > 0 else None
        if found is None:
            return False
        self.beside = self.beside or found["beside"] is not None
        self._places.append(self.raw[found.start() : one.end])
        return True

    def _whose_contents(self, named: list[Mention]) -> list[Mention]:
        """Return the thing whose contents are asked: "does the bowl have", "which is it in"."""
        if not named or not can_hold(named[0]):
            return []
        tail = self.raw[max(named[0].end, 0) :]
        hanging = _HANGING.search(self.raw) if self.asks in ("what", "which") else None
        if hanging is not None and len(named) > 1:
            return named[:1]
        more = len(named) > 1 or self.open
        return named[:1] if more and _HOLDS.match(tail) else []

    def has(self, *words: str) -> bool:
        """Return whether one of these words stands in it."""
        return any(word in self.words for word in words)

    def says(self, pattern: str) -> bool:
        """Return whether a pattern matches its text."""
        return re.search(pattern, " ".join(self.words)) is not None

    def then(self, when_s: float) -> bool:
        """Return whether it asks about the time that something happened."""
        if self._span is None:
            return True
        ends = self.knows.now_s if self.has("since") else self._span.before_s - CLOCK_START_S
        return self._span.after_s - CLOCK_START_S <= when_s <= ends

    @property
    def of_no_time(self) -> tuple[str, ...]:
        """What is said where it names a time that was not understood."""
        unread = unread_times(self._rest)
        return (f"I do not know when '{unread[0]}' was: this is all.",) if unread else ()

    @property
    def state_word(self) -> str:
        """The word of a state that it asks about, "" where it asks about none."""
        hangs = self.asks in ("what", "which") and not _IS_ON.search(self.raw)
        text = _HANGING.sub(" ", self.raw) if hangs else self.raw
        for place in self._places:
            text = text.replace(place, " ")
        words = re.findall(r"[a-z]+", text)
        return next((one for one in reversed(words) if one in request_words().seen), "")

    @property
    def state(self) -> str:
        """The state that it asks about, as memory has it; "clean", "off", "empty" as said."""
        said = self.state_word
        return said if said in ("clean", "off", "empty") else request_words().seen.get(said, "")


def can_hold(one: Mention) -> bool:
    """Return whether things lie in or on what a mention may mean."""
    return any(object_types()[kind].can("receptacle") for kind in one.types)
