"""Read a request: what is asked, of what thing, by rules over its words and MiniLM's nearness.

The reader knows neither the home nor the truth. It is the same for every memory.
"""

import re
from dataclasses import replace
from functools import cache

from karma.errors import KarmaError
from karma.household.places import ROOMS
from karma.household.types import in_words, object_types
from karma.plugins.homes.lived.request import request_forms
from karma.plugins.homes.types import Asked, HomeQuestion, SaidThing
from karma.plugins.rules.language.clock import SaidSpan, read_span, unread_times
from karma.plugins.rules.wording.hints import TYPE_WORDS, Words, kept_words, singular
from karma.types.planning import Meaning
from karma.types.roles import Embedder

_ASKED: tuple[tuple[str, Asked], ...] = (
    (r"\bhow many\b|^count\b|\bnumber of\b", "count"),
    (r"^who\b", "who"),
    (r"^(?:when|what time|at what time)\b", "time"),
    (r"^(?:where|in which|which)\b", "place"),
)
_WANTS = ("i want you to", "i need you to", "i want", "i need")
_LEADS = (
    "please", "could you", "can you", "would you", "do you know", "do you remember", "tell me",
    "any idea", *_WANTS,
)  # fmt: skip
_VERBS = r"(?:put|leave|get|find|bring|take|carry|fetch|place|set|move|have|drop)"
_TO = r"(?:on|onto|in|into|to|at|where)"
_PRONOUNS = ("he", "she", "they", "we", "you", "it", "someone", "somebody", "anyone", "anybody",
             "everyone", "everybody", "nobody", "one", "who")  # fmt: skip
_STATES = {"dirty": "dirty", "unwashed": "dirty", "clean": "cleaned", "sliced": "sliced"}


class Reader:
    """Reads requests; KarmaError if there are no vectors for that embedder."""

    def __init__(self, embedder: Embedder) -> None:
        words = kept_words(TYPE_WORDS, embedder)
        if words is None:
            raise KarmaError(
                f"{TYPE_WORDS}: no vectors of types' words for {embedder.name!r}\n"
                "  To fix: use the embedder 'minilm'"
            )
        self._words: Words = words
        self.embedder = embedder
        self._meanings: dict[str, tuple[Meaning, ...]] = {}

    def read(self, text: str, speaker: str, time_s: float) -> HomeQuestion:
        """Return what a request asks; what it says of nothing known is left empty."""
        said = _without_lead(text.strip().rstrip("?.!"))
        span, rest = read_span(said, time_s)
        rest = rest.strip(" ,")
        asked: Asked = next(
            (what for form, what in _ASKED if re.search(form, rest, re.I)), "errand"
        )
        unread = unread_times(rest)
        if asked == "errand":
            if not _is_errand(text, rest):
                unread = (text.strip(),)
            words, to = _errand_parts(rest)
            thing, destination = self._thing(words, speaker, span), self._place(to) if to else None
        else:
            words, at = _question_parts(rest, asked)
            thing, destination = self._thing(words, speaker, span), None
            if at:
                place = self._place(at)
                thing = replace(thing, place_types=place.place_types, room=place.room)
        if span and (asked == "count" or (asked == "errand" and not _is_of_past(thing))):
            unread += (span.words,)
        return HomeQuestion(
            text=text, speaker=speaker, time_s=time_s, asked=asked, thing=thing,
            destination=destination, unread=unread or _unread_words(words, speaker),
        )  # fmt: skip

    # ------------------------------------------------------------- parts

    def _thing(self, words: str, speaker: str, span: SaidSpan | None) -> SaidThing:
        """Read what is meant: adjectives, noun, deed, place."""
        noun, who, action = _split_deed(words, speaker)
        noun, at = _split_place(noun)
        states, noun = _split_states(_bare(noun))
        said = SaidThing(
            phrase=_bare(words),
            types=self._types(noun),
            states=states,
            who=who,
            action=action,
            after_s=span.after_s if span else None,
            before_s=span.before_s if span else None,
        )
        if at:
            place = self._place(at)
            said = replace(said, place_types=place.place_types, room=place.room)
        return said

    def _types(self, noun: str) -> tuple[Meaning, ...]:
        noun = singular(noun.lower())
        if not noun or noun in ("thing", "one", "object", "item"):
            return ()
        if noun not in self._meanings:
            named = _types_by_name().get(noun)
            if named is not None:
                found: tuple[Meaning, ...] = (Meaning(name=named, similarity=1.0),)
            else:
                near = self._words.nearest(self.embedder.embed([noun])[0], is_deed=False)
                found = near
            self._meanings[noun] = found
        return self._meanings[noun]

    def _place(self, words: str) -> SaidThing:
        """Read a place: "the desk in the bedroom", "where the newspaper is"."""
        words = words.strip()
        other = re.fullmatch(r"where (.+?) (?:is|are|lies|stands)", words, re.I)
        if other:
            return SaidThing(phrase=words, beside=self._thing(other[1], "", None))
        room, rest = _split_room(words)
        kind = _types_by_name().get(singular(_bare(rest).lower()))
        if kind is None and rest:
            near = self._types(_bare(rest))
            kind = next(
                (one.name for one in near if object_types()[one.name].can("receptacle")), None
            )
        return SaidThing(phrase=words, place_types=(kind,) if kind else (), room=room)


def _without_lead(text: str) -> str:
    """Return a request without its polite beginning."""
    for _ in range(2):
        for lead in _LEADS:
            if text.lower().startswith(f"{lead} "):
                text = text[len(lead) + 1 :]
    return text


def _is_of_past(said: SaidThing) -> bool:
    """Return whether a thing is known by what was: a time of it is then no time of the errand."""
    return bool(said.who or said.action or said.place_types or said.room or said.beside)


def _is_errand(text: str, rest: str) -> bool:
    """Return whether a text orders something: it begins with a verb, or says what is wanted.

    >>> _is_errand("has anyone moved the mug", "has anyone moved the mug")
    False
    >>> _is_errand("I want the mug on the desk", "the mug on the desk")
    True
    """
    words = text.lower()
    wanted = re.search(rf"\b(?:{'|'.join(_WANTS)})\b", words) is not None
    return wanted or re.match(rf"{_VERBS}\b(?! (?:you|we|they|any|some))", rest, re.I) is not None


def _unread_words(words: str, speaker: str) -> tuple[str, ...]:
    """Return the clause of a noun phrase of which no deed or place was read.

    >>> _unread_words("the cup that Ann threw away", "Ben")
    ('that Ann threw away',)
    >>> _unread_words("the cup that Ann washed", "Ben")
    ()
    """
    noun, who, _ = _split_deed(words, speaker)
    if who and not (is_name(who) or (who.isalpha() and who not in _PRONOUNS)):
        return (who,)
    noun = _split_place(noun)[0]
    verbs = "|".join(re.escape(verb) for verbs in request_forms().did.values() for verb in verbs)
    left = re.search(
        r" (?:that|which|who|whom|whose|except|but|if|unless|because) .*"
        rf"|\S+ (?:{verbs})$",
        f" {noun}", re.I,
    )  # fmt: skip
    return (left[0].strip(),) if left else ()


def _errand_parts(text: str) -> tuple[str, str]:
    """Return what an errand is about, and where it shall go.

    >>> _errand_parts("get the cup and put it on the dining table in the kitchen")
    ('the cup', 'the dining table in the kitchen')
    >>> _errand_parts("put the cup that Ann put down where the book is")
    ('the cup that Ann put down', 'where the book is')
    """
    both = re.fullmatch(rf"{_VERBS} (.+?) and {_VERBS} (?:it|them) {_TO} (.+)", text, flags=re.I)
    where = re.fullmatch(rf"(?:{_VERBS} )?(.+?)(?: and {_VERBS} it)? (where .+)", text, re.I)
    if where:
        return where[1], where[2]
    if both:
        return both[1], both[2]
    body = re.sub(rf"^{_VERBS} ", "", text, flags=re.I)
    ends = [found for found in re.finditer(rf" {_TO} (the .+?)(?= {_TO} the |$)", body, re.I)]
    if not ends:
        return body, ""
    last = ends[-1]
    if len(ends) > 1 and _split_room(f"x {body[last.start() + 1 :]}")[0]:
        last = ends[-2]
    return body[: last.start()], re.sub(rf"^ {_TO} ", "", body[last.start() :], flags=re.I)


def _question_parts(text: str, asked: Asked) -> tuple[str, str]:
    """Return what a question is about, and the place that a count is of."""
    if asked == "count":
        found = re.fullmatch(
            r"(?:how many|count|what is the number of) (?:the )?(.+?)(?: are| is)?"
            r" (?:on|in|at) (the .+)",
            text, re.I,
        )  # fmt: skip
        return (found[1], found[2]) if found else (text, "")
    for form in (
        r"where (?:is|are|was|were) (.+)",
        r"where (?:can|could|did|do) I find (.+)",
        r"where did (.+) end up",
        r"where (?:did|has|have|had) (.+)",
        r"where (.+?) (?:is|are|was|were)",
        r"(?:what time|at what time|when) did (.+)",
        r"who (?:moved|had|took|was the last to move) (.+?)(?: last)?",
    ):
        found = re.fullmatch(form, text, re.I)
        if found:
            return found[1], ""
    return re.sub(r"^\w+ ", "", text), ""


@cache
def _verbs() -> tuple[tuple[str, str], ...]:
    """Return verbs with their actions, the longest first."""
    forms = request_forms()
    pairs = [
        (verb, action)
        for table in (forms.did, forms.do)
        for action, verbs in table.items()
        for verb in verbs
    ]
    pairs.append(("put", "PutObject"))  # "where did Ben put the mug"
    return tuple(sorted(pairs, key=lambda pair: (-len(pair[0]), pair[0])))


def _split_deed(words: str, speaker: str) -> tuple[str, str, str]:
    """Return a noun phrase without its deed, who did it, and what.

    >>> _split_deed("the cup that I washed", "Ann")
    ('the cup', 'Ann', 'CleanObject')
    >>> _split_deed("Ben put down the keys", "Ann")
    ('the keys', 'Ben', 'PutObject')
    """
    for verb, action in _verbs():
        clause = re.fullmatch(rf"(.+?) (?:that|which) (.+?) {verb}", words)
        if clause:
            return clause[1], _who(clause[2], speaker), action
        bare = re.fullmatch(rf"(.+) {verb}", words)
        if bare:
            noun, name = _ending_name(bare[1])
            if noun and name:
                return noun, _who(name, speaker), action
        before = re.fullmatch(rf"(.+?) {verb} (.+)", words)
        if before and (is_name(before[1]) or re.match(r"(?:the|my|a|an) ", before[2])):
            return before[2], _who(before[1], speaker), action
    return words, "", ""


def _ending_name(words: str) -> tuple[str, str]:
    """Return words without the name that they end with, and that name.

    >>> _ending_name("the cup Mary Ann"), _ending_name("the cup")
    (('the cup', 'Mary Ann'), ('the cup', ''))
    """
    all_words = words.split()
    begin = len(all_words)
    while begin and is_name(all_words[begin - 1]):
        begin -= 1
    return " ".join(all_words[:begin]), " ".join(all_words[begin:])


def _who(words: str, speaker: str) -> str:
    return speaker if words in ("I", "i") else words


def is_name(words: str) -> bool:
    """Return whether words are a name: each begins with a capital, if its script has capitals.

    >>> [is_name(one) for one in ("Mary Ann", "O'Brien", "李明", "I", "my daughter", "he")]
    [True, True, True, True, False, False]
    """
    firsts = [word[0] for word in words.split()]
    return bool(firsts) and all(
        one.isalpha() and (one != one.lower() or one == one.upper()) for one in firsts
    )


def _split_place(words: str) -> tuple[str, str]:
    """Return a noun phrase without its place, and the place."""
    found = re.fullmatch(r"(.+?) (?:that is )?(?:on|in|at|from) (the .+)", words, re.I)
    return (found[1], found[2]) if found else (words, "")


def _split_states(words: str) -> tuple[tuple[str, ...], str]:
    first, _, rest = words.partition(" ")
    state = _STATES.get(first.lower())
    return ((state,), rest) if state and rest else ((), words)


def _split_room(words: str) -> tuple[str, str]:
    """Return the kind of room that a place is in, and the place without it.

    >>> _split_room("the desk in the living room"), _split_room("the kitchen")
    (('living', 'the desk'), ('kitchen', ''))
    """
    names = {**{kind: kind for kind in ROOMS}, "living room": "living"}
    rooms = "|".join(sorted(names, key=len, reverse=True))
    found = re.fullmatch(rf"(.*?)(?: ?\bin )?the ({rooms})", words, re.I)
    return (names[found[2].lower()], found[1].strip()) if found else ("", words)


def _bare(words: str) -> str:
    return re.sub(r"^(?:the|a|an|my|our|some) ", "", words.strip(), flags=re.I)


@cache
def _types_by_name() -> dict[str, str]:
    """Return the types' own names as people write them."""
    return {in_words(name): name for name in object_types()}
