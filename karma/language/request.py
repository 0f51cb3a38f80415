"""What was asked, from the words alone: form, deeds, things, exclusions, times and conditions.

A parser tags the words and says what hangs on what (`Parser`); this is the layer from there to a
`Request`, over what a home holds (`Lexicon`) and what verbs ask for (`verbs.toml`). It is the same
for every planner, and guesses nothing: a word that no field holds is kept in `unread`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import msgspec

from karma.contracts import Condition, Form, Mention, Parser, Request, SaidDeed, Word
from karma.files import read_toml
from karma.household.types import object_types
from karma.language.hints import singular
from karma.language.lexicon import Lexicon
from karma.language.slips import as_meant, in_order, spelt, without_courtesy
from karma.language.times import time_words
from karma.language.words import word_lists

VERBS = Path(__file__).with_name("verbs.toml")
_NUMBERS = {
    "a": None, "an": None, "one": 1, "two": 2, "both": 2, "three": 3, "four": 4, "five": 5, "six": 6,
    "seven": 7, "eight": 8, "nine": 9, "ten": 10, "dozen": 12, "couple": 2,
}  # fmt: skip
_EVERY = frozenset(("all", "every", "each", "both"))
_ANYTHING = frozenset(
    ("everything", "anything", "all", "whatever", "things", "stuff", "items", "objects", "lot")
)
_VAGUE = frozenset((
    "it", "them", "this", "that", "these", "those", "one", "ones", "thing", "something", "someone",
    "somewhere", "anywhere", "nothing", "nowhere", "other", "another", "rest", "us", "him", "her",
    "place", "they", "itself", "which", "what", "bit", "way", "others",
))  # fmt: skip
_ME = frozenset(("me", "us", "myself"))
_WHERE_ELSE = frozenset(("there", "here", "elsewhere", "somewhere", "anywhere"))
_DESTINATIONS = frozenset((
    "in", "on", "into", "onto", "to", "inside", "at", "under", "upon", "atop", "over", "within",
    "beneath", "underneath", "near", "beside", "by", "next", "alongside", "behind", "between",
))  # fmt: skip
_NEAR = frozenset(("near", "beside", "by", "next", "alongside", "behind", "between", "close"))
_SOURCES = frozenset(("from", "off", "out"))
_TOOLS = frozenset(("with", "using"))
_IGNORED = frozenset(
    ("for", "of", "about", "as", "like", "than", "during", "via", "per", "through")
)
_WH = frozenset(
    (
        "what",
        "where",
        "who",
        "when",
        "why",
        "how",
        "which",
        "whose",
        "whom",
        "what's",
        "where's",
        "who's",
    )
)
_BE = frozenset(("be", "is", "are", "was", "were", "am", "'s", "'re", "been", "being"))
_AUX = frozenset(
    (
        "do",
        "have",
        "can",
        "could",
        "will",
        "would",
        "shall",
        "should",
        "must",
        "may",
        "might",
        "be",
        "ought",
    )
)
_ASKS = frozenset(
    (
        "is",
        "are",
        "was",
        "were",
        "am",
        "do",
        "does",
        "did",
        "has",
        "have",
        "had",
        "isn't",
        "aren't",
        "can",
        "could",
        "will",
        "would",
        "shall",
        "should",
        "may",
        "might",
    )
)
_LEADING = frozenset(
    (
        "want",
        "need",
        "like",
        "wish",
        "try",
        "remember",
        "forget",
        "help",
        "make",
        "let",
        "mind",
        "go",
        "start",
        "begin",
        "come",
        "please",
        "love",
    )
)
_NEEDS = frozenset(("need", "want", "like", "wish", "require", "love", "prefer"))
_HABIT = frozenset(("always", "usually", "normally", "never", "generally", "typically"))
_LIVES = frozenset(("live", "belong", "stay"))
_NEGATIONS = frozenset(("not", "n't", "nt", "never", "no", "without", "don't", "dont"))
_NEEDS_PLACE = frozenset((
    "put", "place", "set", "lay", "move", "stick", "pop", "shove", "transfer", "deposit", "insert",
    "slide", "relocate", "shift", "position", "slip", "transport", "deliver", "add", "plonk", "leave",
))  # fmt: skip
_SMALL_VERBS = frozenset(
    (
        "let",
        "ensure",
        "keep",
        "see",
        "go",
        "try",
        "help",
        "sure",
        "check",
        "say",
        "tell",
        "know",
        "think",
        "mean",
        "get",
        "come",
        "have",
        "do",
        "be",
        "need",
        "want",
        "like",
        "wish",
        "love",
        "remember",
        "forget",
        "mind",
        "please",
        "can",
        "could",
        "would",
        "will",
        "should",
        "must",
        "might",
        "may",
        "lie",
        "stand",
        "sit",
        "reach",
    )
)
_DROPPED = frozenset(
    (
        "kitchen",
        "bathroom",
        "bedroom",
        "living",
        "room",
        "glass",
        "metal",
        "wood",
        "wooden",
        "plastic",
        "ceramic",
        "steel",
        "silver",
        "dinner",
        "nearest",
        "other",
        "second",
        "first",
        "third",
        "left",
        "right",
        "front",
        "back",
        "top",
        "bottom",
        "upper",
        "lower",
        "middle",
        "big",
        "small",
        "red",
        "blue",
        "green",
        "black",
        "white",
        "yellow",
        "brown",
        "grey",
        "gray",
    )
)
_NEVER_MIND = frozenset((
    "please", "now", "just", "then", "again", "too", "also", "carefully", "gently", "quickly", "slowly",
    "right", "away", "up", "down", "back", "over", "together", "there", "here", "so", "well", "only",
    "simply", "quick", "nicely", "neatly", "properly", "otherwise", "instead", "still", "already", "all",
    "today", "around", "along", "home", "sure", "ahead", "possible", "once", "straight", "directly",
    "thoroughly", "even", "safely", "immediately", "really", "very", "bit", "as", "actually", "though",
    "both", "each", "off", "on", "out", "in", "yet", "but", "and", "or", "to", "that", "which", "own",
    "time", "good", "ready", "done", "able", "twice", "everyone", "robot", "course", "favour", "favor",
    "minute", "free", "nice", "great", "lovely", "clockwise", "time", "else", "least", "most",
))  # fmt: skip
_ROOMS = frozenset(("kitchen", "room", "bathroom", "bedroom", "house", "home", "flat", "apartment"))
_STATES = {
    "dirty": "dirty", "unwashed": "dirty", "clean": "clean", "on": "on", "running": "on", "lit": "on", "off": "off",
    "open": "opened", "closed": "closed", "shut": "closed", "full": "filled", "filled": "filled",
    "empty": "empty", "sliced": "sliced", "cut": "sliced", "broken": "broken", "hot": "heated",
    "warm": "heated", "cold": "cooled", "cool": "cooled", "cooked": "cooked",
}  # fmt: skip


class _Verbs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    deeds: dict[str, tuple[str, ...]]
    states: dict[str, tuple[str, ...]]


@cache
def _verbs() -> tuple[Mapping[str, str], Mapping[str, str]]:
    """Return verb -> deed, and how a thing is to be -> deed."""
    table = read_toml(VERBS, _Verbs)
    verbs: dict[str, str] = {}
    for deed, names in table.deeds.items():
        for name in names:
            verbs.setdefault(name, deed)
    return verbs, {word: deed for deed, words in table.states.items() for word in words}


class RequestReader:
    """Reads requests.

    Args:
        parser: of English.
        lexicon: what things are called.
    """

    def __init__(self, parser: Parser, lexicon: Lexicon) -> None:
        self._parser, self._lexicon = parser, lexicon
        self._kept: dict[str, tuple[Request, ...]] = {}

    def read(self, text: str) -> tuple[Request, ...]:
        """Return what each sentence of a text asks; () where nothing is said."""
        if text not in self._kept:
            self._kept[text] = tuple(self._sentences(text))
        return self._kept[text]

    def _sentences(self, text: str) -> Iterator[Request]:
        meant = spelt(as_meant(text), self._is_known, self._vocabulary)
        ends = [*(one.end() for one in re.finditer(r"(?<!\bMr)(?<!\bMrs)(?<!\bDr)[.?!;]+(?=\s|$)", meant)), len(meant)]
        parts = [meant[a:b].strip() for a, b in zip([0, *ends], ends, strict=False)]
        meant = " ".join(self._plainly(part) for part in parts if part)
        words = self._parser.parse(meant)
        first = 0
        before: tuple[Mention, ...] = ()
        last: tuple[SaidDeed, ...] = ()
        for number, word in enumerate(words):
            ends = word.text in (".", "!", "?", ";", "...") or number == len(words) - 1
            if not ends:
                continue
            part = words[first : number + 1]
            if any(re.search(r"\w", one.text) for one in part):
                found = _going_on(self._one(meant, part, first, before), last)
                before, last = (*before, *found.alone, *found.mentions), found.deeds[-1:] or last
                yield found
            first = number + 1

    def _plainly(self, sentence: str) -> str:
        """Return a sentence without courtesy; its own end stays."""
        found = in_order(without_courtesy(sentence, _is_deed), _base_of_deed)
        return f"{found}." if found != sentence and found[-1:].isalnum() else found

    def _is_known(self, word: str) -> bool:
        return self._parser.knows(word) or word in self._vocabulary_set

    @cached_property
    def _vocabulary(self) -> list[str]:
        verbs = {word for text in _verbs()[0] for word in text.split()}
        return sorted({*self._lexicon.words, *verbs, "the", "with", "from", "into", "onto"})

    @cached_property
    def _vocabulary_set(self) -> frozenset[str]:
        return frozenset(self._vocabulary)

    def _one(
        self, text: str, words: Sequence[Word], first: int, before: Sequence[Mention]
    ) -> Request:
        moved = [
            replace(word, head=min(max(word.head - first, 0), len(words) - 1)) for word in words
        ]
        return _Sentence(
            text, moved, self._lexicon, [one for one in before if not one.vague]
        ).request()


@dataclass(slots=True)
class _Group:
    """Things, and the places that are named with them."""

    things: list[Mention] = field(default_factory=list)
    places: list[Mention] = field(default_factory=list)
    at: tuple[str, ...] = ()  # of things that are named afterwards

    def told_by(self, place: Mention, deed: str) -> None:
        """Take a place that says which thing is meant."""
        if self.things:
            self.things[-1] = replace(self.things[-1], at=place.types)
        elif deed in ("wash", "look"):
            self.things.append(place)
        else:
            self.at = place.types

    def pair(self, deed: str) -> tuple[list[Mention], Mention | None]:
        """Return the things, and where they go; other places say which things are meant."""
        things, place = self.things, self.places[-1] if self.places else None
        if len(self.places) > 1 and things:
            things = [*things[:-1], replace(things[-1], at=self.places[0].types)]
        if self.at:
            things = [replace(one, at=one.at or self.at) for one in things]
        if deed not in ("put", "take", "") and place is not None:
            if not things:
                return [place], None
            if deed not in ("throw", "go"):
                return [replace(one, at=one.at or place.types) for one in things], None
        return things, place


@dataclass(slots=True)
class _Sentence:
    """One sentence being read; a word is taken once something is made of it."""

    text: str
    words: Sequence[Word]
    lexicon: Lexicon
    before: Sequence[Mention]  # what the sentences before it named
    taken: set[int] = field(default_factory=set)
    gone: set[int] = field(default_factory=set)  # of them, what is no part of the errand
    times: list[str] = field(default_factory=list)
    conditions: list[Condition] = field(default_factory=list)
    exclusions: list[Mention] = field(default_factory=list)
    forbidden: list[SaidDeed] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    alone: list[Mention] = field(default_factory=list)

    # ------------------------------------------------------------- the whole

    def request(self) -> Request:
        """Read it."""
        said = self.text[self.words[0].start : self.words[-1].end]
        form = self._question_or_talk()
        if form:
            return Request(text=said, form=form)
        self._polite()
        self._topic()
        self._background()
        self._read_conditions()
        self._read_times()
        self._read_exclusions()
        form, deeds = self._deeds()
        lacking = ""
        if form == "errand":
            lacking = self._lacking(deeds)
            self._read_rest()
        if lacking:
            form = "incomplete"
        if form == "errand" and not deeds and not (self.forbidden or self.exclusions):
            form, lacking = "incomplete", "what"
        return Request(
            text=said,
            form=form,
            errand=self._errand(),
            deeds=tuple(deeds),
            forbidden=tuple(_of_what(one, deeds) for one in self.forbidden),
            exclusions=tuple(self.exclusions),
            times=tuple(self.times),
            conditions=tuple(self.conditions),
            unread=tuple(self.unread),
            lacking=lacking,
            alone=tuple(self.alone) if form != "errand" else (),
            whole=self.text,
        )

    def _errand(self) -> str:
        """Return the words that are left to plan by."""
        kept = [n for n in range(len(self.words)) if n not in self.gone]
        text = ""
        for number in kept:
            word = self.words[number]
            glued = number > 0 and self.words[number - 1].end == word.start
            text += word.text if glued and number - 1 in kept else f" {word.text}"
        text = re.sub(r"\b(?:though|however)\b ?", "", text)
        text = re.sub(r"^(?:[\s,.;:]|and\b|but\b|then\b|so\b)+", "", text)
        text = re.sub(r"(?:[\s,.;:!?]|\band\b|\bbut\b|\bthen\b)+$", "", text)
        text = re.sub(r"\s+([,.;!?])", r"\1", re.sub(r"\s+", " ", text)).strip()
        about = next((one.thing.text for one in self.conditions if one.thing is not None), "")
        return re.sub(r"\b(?:it|them)\b", f"the {about}", text, count=1) if about else text

    # ------------------------------------------------------------- small looks

    def _low(self, number: int) -> str:
        return self.words[number].text.lower() if 0 <= number < len(self.words) else ""

    def _open(self) -> list[int]:
        """Return the numbers of words of which nothing was made yet, signs left out."""
        return [
            n
            for n, w in enumerate(self.words)
            if n not in self.taken and w.text[0].isalnum() or w.text == "'s"
        ]

    def _drop(self, begin: int, end: int) -> str:
        """Take words out of the errand; return them as they were said."""
        self.taken.update(range(begin, end))
        self.gone.update(range(begin, end))
        return self.text[self.words[begin].start : self.words[end - 1].end]

    def _has_subject(self, verb: int) -> bool:
        return any(
            w.head == verb and w.dep.startswith(("nsubj", "csubj", "expl"))
            for n, w in enumerate(self.words)
            if n != verb
        )

    # ------------------------------------------------------------- form

    def _question_or_talk(self) -> Form | None:
        """Return "question" where it is one; "talk" where it holds nothing to do or know."""
        open_ = self._open()
        if not open_:
            return "talk"
        at = open_[0]
        while at < len(self.words) and self._low(at) in (
            "and",
            "so",
            "but",
            "then",
            "now",
            "well",
            "say",
            ",",
        ):
            at += 1
        first, second = self._low(at), self._low(at + 1)
        marked = self.words[-1].text == "?"
        if first in ("can", "could", "would", "will", "may", "might", "won't", "ca", "wo") and (
            second in ("you", "i", "we", "u", "ya", "n't") or self._low(at + 2) in ("you",)
        ):
            rest = " ".join(self._low(n) for n in range(at + 2, min(at + 5, len(self.words))))
            return (
                "question"
                if re.match(r"(?:please )?(?:tell|say|explain|remember|see|know)\b", rest)
                else None
            )
        if first in ("do", "does", "did") and second in ("not", "n't", "nt"):
            return None if first == "do" else "question"
        if (
            first == "do"
            and (self.words[at + 1].tag if at + 1 < len(self.words) else "") in ("DT", "PRP$")
            and not marked
        ):
            return None
        if (
            first == "why"
            and second in ("do", "not")
            and self._low(at + 2) in ("n't", "not", "you")
        ):
            return None
        if first in ("have", "has") and second in ("a", "the", "some"):
            return None
        if re.match(
            r"(?:please )?(?:tell me|any idea|i wonder|do you know|can you tell|remind me) ?(?:what|where|who|when|why|how|which|whether|if)",
            " ".join(self._low(n) for n in range(at, min(at + 6, len(self.words)))),
        ):
            return "question"
        if first in _WH and second != "about":
            if first in ("when", "what", "whatever", "where") and self._later_order(at):
                return None
            return "question"
        if first in _ASKS:
            return "question"
        if marked and not self._later_order(at):
            return "question"
        words = {self._low(n) for n in open_}
        if words <= {
            "hello",
            "hi",
            "yes",
            "no",
            "good",
            "morning",
            "night",
            "thanks",
            "ok",
            "great",
            "well",
            "done",
            "nice",
            "bye",
            "cool",
            "right",
            "job",
            "evening",
        }:
            return "talk"
        return None

    def _later_order(self, at: int) -> bool:
        """Return whether an order stands behind the first comma, or at the very beginning."""
        if self._is_order(at):
            return True
        commas = [n for n in range(at, len(self.words)) if self.words[n].text == ","]
        return any(self._is_order(n + 1) for n in commas[:2])

    def _is_order(self, number: int) -> bool:
        if number >= len(self.words) or self._low(number) in _AUX:
            return False
        verbs, _ = _verbs()
        if self.words[number].tag == "VBG" and number == min(set(range(len(self.words))) - self.gone):
            return _is_deed(self._low(number))
        return self._low(number) in verbs or (
            self.words[number].tag == "VB" and not self._has_subject(number)
        )

    def _polite(self) -> None:
        """Leave out what leads to an order."""
        said = [self._low(n) for n in range(len(self.words))]
        text = " ".join(said)
        lead = re.match(
            r"(?:and |so |now |well |oh |then |, )*"
            r"(?:(?:can|could|would|will|wo|ca|may|might) (?:n't )?(?:you|ya|u|i|we)(?: please)?(?: maybe| perhaps| possibly| just| kindly)?"
            r"(?: be so kind as to| be able to| mind| go and| go ahead and| have| ask you to| get you to)?"
            r"|why (?:do )?(?:n't )?(?:you|not)|i (?:would|'d) (?:like|love|want|prefer) you to|i (?:want|need|wish|expect) you to"
            r"|(?:please )?(?:make sure|be sure|ensure|see to it)(?: that| to)?(?: you)?|do n't forget to|remember to|try to|go ahead and|go and"
            r"|you (?:should|must|need to|have to|can|could|may|might)|let 's|let us|it is time to|time to|feel free to|(?:i was )?wondering if you (?:could|can)"
            r"|would it be possible to|is it possible to)\b(?: ,)? ?",
            text,
        )
        if not lead:
            return
        count = len(lead[0].split())
        if count and count < len(self.words):
            self._drop(0, count)

    def _topic(self) -> None:
        """Take what stands ahead of an order: "the lettuce: wash it"."""
        begin = next((n for n in range(len(self.words)) if n not in self.gone), 0)
        end = self._noun_end(begin, len(self.words))
        if end == begin or self._low(end) not in (":", ",", "-") or end + 1 >= len(self.words):
            return
        pronouns = [n for n in range(end, len(self.words)) if self._low(n) in ("it", "them")]
        one = self._mention(begin, end) if pronouns else None
        if one is not None and one.types:
            self.before = [*self.before, one]
            self._drop(begin, end + 1)

    def _background(self) -> None:
        """Leave out clauses that only tell something, where others ask for something."""
        verbs = [n for n in range(len(self.words)) if n not in self.taken and self._tells(n)]
        for verb in verbs:
            if verb in self.taken:
                continue
            begin, end = self._told_clause(verb)
            if not self._asks_elsewhere(begin, end):
                continue
            found = [one for _, one in self._mentions(range(begin, end))]
            self.before = [*self.before, *(one for one in found if one.types)]
            self._drop(begin, end)

    def _tells(self, verb: int) -> bool:
        """Return whether a verb has a subject of its own and neither wishes nor needs anything."""
        word = self.words[verb]
        if not word.tag.startswith("VB") or word.dep in ("aux", "auxpass", "relcl", "acl", "amod", "xcomp"):
            return False
        subject = next((n for n, w in enumerate(self.words) if w.head == verb and n < verb and w.dep in ("nsubj", "nsubjpass", "expl") and n not in self.taken), None)
        if subject is None or self._low(subject) in ("you", "u", "ya"):
            return False
        helpers = {w.text.lower() for w in self.words if w.head == verb and w.dep in ("aux", "auxpass", "neg")}
        negated = helpers & {"n't", "not", "never", "nt"} or any(self._low(n) == "no" for n in range(verb, min(verb + 3, len(self.words))))
        if self._low(verb - 1) in ("if", "unless") or any(self._low(n) in ("if", "unless", "when", "once", "after", "before", "until", "whenever") for n in range(max(subject - 3, 0), subject)):
            return False
        if negated:
            return True
        if word.lemma in _NEEDS | {"go", "belong"} or helpers & {"should", "must", "can", "could", "ought", "may"}:
            return False
        return True

    def _told_clause(self, verb: int) -> tuple[int, int]:
        """Return where the clause of a verb begins and ends."""
        begin = verb
        while begin > 0 and begin - 1 not in self.gone and self.words[begin - 1].text not in (",", ";", ":", ".") and self._low(begin - 1) not in ("so", "because", "since", "but"):
            begin -= 1
        if self._low(begin - 1) in ("because", "since") or (self._low(begin - 1) == "so" and begin - 1 > 0):
            begin -= 1
        end = verb + 1
        while end < len(self.words):
            low = self._low(end)
            if self.words[end].text in (",", ";", ":", ".", "!", "?") or low == "so" or (low in ("and", "but", "then") and self._is_order(end + 1)):
                break
            end += 1
        while self._low(end) in (",", "so", "and", "but", ":", "then"):
            end += 1
        return begin, end

    def _asks_elsewhere(self, begin: int, end: int) -> bool:
        """Return whether an order or a wish stands outside of a clause."""
        outside = [n for n in range(len(self.words)) if not begin <= n < end and n not in self.gone]
        table, _ = _verbs()
        for n in outside:
            word = self.words[n]
            low = word.text.lower()
            starts = n - 1 not in outside or self._starts_clause(n) or self._low(n - 1) in ("and", "then", "to", "so")
            if (low in table or word.lemma in table) and starts and not self._has_subject(n) and low not in ("like", "back"):
                return True
            if word.lemma in _NEEDS and self._has_subject(n):
                return True
        return False

    # ------------------------------------------------------------- conditions and times

    def _read_conditions(self) -> None:
        number = 0
        while number < len(self.words):
            word = self._low(number)
            in_case = word == "in" and self._low(number + 1) == "case"
            if word in ("if", "unless", "whether", "provided") or in_case:
                if self._would_be_nice(number):
                    number += 1
                    continue
                begin = number - 1 if self._low(number - 1) == "only" else number
                end = self._clause_end(number + 1 + in_case)
                body = range(number + 1 + in_case, end)
                held = self._condition(body, holds=word != "unless")
                text = self._drop(begin, end)
                self.conditions.append(replace(held, text=text))
                number = end
            elif word == "otherwise" or (word == "else" and self.conditions):
                end = self._clause_end(number + 1, commas=False)
                self._drop(number, end)
                number = end
            else:
                number += 1

    def _would_be_nice(self, number: int) -> bool:
        """Return whether "if" belongs to a wish: "it would be lovely if the tomato were ..."."""
        before = " ".join(self._low(n) for n in range(max(number - 6, 0), number))
        return bool(re.search(r"\b(?:would|'d) (?:be|appreciate|like|love)\b|\bwondering$", before))

    def _clause_end(self, begin: int, *, commas: bool = True, orders: bool = True) -> int:
        """Return where a clause ends: at a comma, or before the order that follows it."""
        for number in range(begin, len(self.words)):
            sign = self.words[number].text
            if sign in (".", "!", "?", ";", ":") or (commas and sign in (",", "then")):
                return number
            if (
                orders and commas
                and number > begin + 2
                and self._is_order(number)
                and self.words[number].tag in ("VB", "VBP")
                and self._low(number - 1) not in ("to", "is", "are", "it", "been", "the")
            ):
                return number
        return len(self.words)

    def _condition(self, body: range, *, holds: bool) -> Condition:
        words = [self._low(n) for n in body]
        negated = any(one in ("not", "n't", "no") for one in words)
        mentions = [one for _, one in self._mentions(body)]
        thing = next(iter(mentions), None)
        state = next((_STATES[one] for one in reversed(words) if one in _STATES), "")
        at: tuple[str, ...] = ()
        if "there" in words[:3]:
            state = "there"
            at = mentions[1].types if len(mentions) > 1 else ()
        if thing is not None and thing.vague:
            thing = None
        return Condition(text="", thing=thing, state=state, at=at, holds=holds != negated)

    def _read_times(self) -> None:
        offset = self.words[0].start
        text = self.text[offset : self.words[-1].end]
        for begin, end in time_words(text):
            inside = [
                n
                for n, w in enumerate(self.words)
                if w.start < offset + end and w.end > offset + begin and n not in self.taken
            ]
            if not inside or text[begin:end].lower() in ("today", "at one", "on one"):
                continue
            self.times.append(self._drop(inside[0], inside[-1] + 1))
        for number in range(len(self.words)):
            word = self._low(number)
            if number in self.taken or word not in (
                "when",
                "whenever",
                "once",
                "after",
                "until",
                "till",
                "before",
                "while",
                "as",
            ):
                continue
            if word == "as" and self._low(number + 1) != "soon":
                continue
            subject = next(
                (
                    n
                    for n in range(number + 1, min(number + 5, len(self.words)))
                    if self.words[n].dep.startswith("nsubj")
                ),
                None,
            )
            if (
                subject is None
                or self._low(subject) in ("you", "u")
                or self._low(number) == "once"
                and number == 0
                and False
            ):
                continue
            done = {self._low(n) for n in range(subject, min(subject + 4, len(self.words)))}
            if (
                done
                & (
                    set(_STATES)
                    | {
                        "done",
                        "finished",
                        "ready",
                        "washed",
                        "rinsed",
                        "warmed",
                        "heated",
                        "chilled",
                    }
                )
                and "dark" not in done
            ):
                continue
            end = self._clause_end(number + 1)
            self.times.append(self._drop(number, end))

    # ------------------------------------------------------------- exclusions

    def _read_exclusions(self) -> None:
        number = 0
        while number < len(self.words):
            if number in self.taken:
                number += 1
                continue
            number = self._excluded_at(number) or number + 1

    def _excluded_at(self, number: int) -> int | None:
        """Read what is ruled out from here on; return where it ends, None if nothing is."""
        word, following = self._low(number), self._low(number + 1)
        size = self._marker(number)
        begin = (
            number - 1
            if self._low(number - 1) in ("but", "and", "just", ",") and number - 1 not in self.taken
            else number
        )
        if size:
            end = self._phrase_end(number + size)
            found = [one for _, one in self._mentions(range(number + size, end))]
            if not found:
                return None
            self.exclusions += found
            self._drop(begin, end)
            return end
        negated = (
            word in ("not", "never", "n't", "nt", "without", "no") and number not in self.taken
        )
        if not negated or word == "no":
            return None
        told = self.words[number].head
        subject = next(
            (w for w in self.words if w.head == told and w.dep.startswith("nsubj")), None
        )
        own = subject is not None and subject.text.lower() not in ("you", "u")
        if own and word in ("not", "n't", "nt", "never"):
            return None
        verb = number + 1
        while self._low(verb) in (
            "to",
            "ever",
            "please",
            "you",
            "just",
            "even",
            "be",
            "go",
            "and",
            "let",
        ):
            verb += 1
        helper = self._low(number - 1) in (
            "do",
            "does",
            "should",
            "must",
            "may",
            "could",
            "would",
            "did",
            "ca",
            "can",
            "please",
        )
        begin = number - 1 if helper else number
        while (
            self._low(begin - 1) in ("but", "and", "just", "please", ",", "so", "you")
            and begin - 1 not in self.taken
        ):
            begin -= 1
        end = self._order_end(verb)
        if verb >= len(self.words) or end <= verb:
            return None
        if self._low(verb) == "forget" or following == "forget":
            self._drop(begin, verb + 1 + (self._low(verb + 1) == "to"))
            return verb + 2
        found = [one for _, one in self._mentions(range(verb, end))]
        deed, text, size = self._deed_at(verb)
        if size == 1 and (later := self._particle_later(verb, end)):
            deed, text = later
        if not (deed or self.words[verb].tag.startswith("VB")):
            self.exclusions += found
        elif self._low(verb) in (
            "use",
            "using",
            "touch",
            "touching",
            "disturb",
            "take",
            "forgetting",
        ):
            self.exclusions += found
        else:
            things, place = self._split(range(verb + size, end), deed)
            self._others = []
            self.forbidden.append(
                SaidDeed(
                    verb=text or self._low(verb),
                    deed=deed,
                    start=self.words[verb].start,
                    things=tuple(things),
                    place=place,
                )
            )
        self._drop(begin, end)
        return end

    def _marker(self, number: int) -> int:
        """Return how many words rule out what follows: "instead of", "rather than", "except for"."""
        words = [self._low(number + n) for n in range(3)]
        pair = " ".join(words[:2])
        if pair in (
            "instead of",
            "rather than",
            "other than",
            "apart from",
            "except for",
            "and not",
            "but not",
        ):
            after = self._low(number + 2)
            prep = after in _DESTINATIONS | _SOURCES
            if pair in ("and not", "but not") and self.words[
                min(number + 2, len(self.words) - 1)
            ].tag in ("VB", "VBG"):
                return 0
            return 2 + prep
        if words[0] in ("except", "excluding", "besides"):
            return 1
        if (
            words[0] == "but"
            and self._before_every(number)
            and self.words[min(number + 1, len(self.words) - 1)].tag
            in ("DT", "PRP$", "NN", "NNS", "NNP")
        ):
            return 1
        if words[0] == "not" and self._low(number - 1) in (",", "and", "but"):
            prep = words[1] in _DESTINATIONS | _SOURCES
            at = number + 1 + prep
            if at < len(self.words) and self.words[at].tag in ("DT", "PRP$", "NN", "NNS", "NNP"):
                return 1 + prep
        return 0

    def _before_every(self, number: int) -> bool:
        return any(
            self._low(n) in _EVERY | _ANYTHING for n in range(number)
        ) and not self._is_order(number + 1)

    def _phrase_end(self, begin: int) -> int:
        """Return where a noun phrase ends that begins here."""
        last = begin
        for number in range(begin, len(self.words)):
            word = self.words[number]
            if not (
                word.tag.startswith(("NN", "JJ", "CD", "PRP", "PO"))
                or word.tag in ("DT", "PDT", "VBN", "VBG")
                or word.text == "-"
            ):
                if (
                    word.text.lower() in ("and", "or")
                    and number > begin
                    and number + 1 < len(self.words)
                    and self.words[number + 1].tag in ("DT", "NN", "NNS", "PRP$")
                    and not self._is_order(number + 1)
                ):
                    continue
                if (
                    word.text.lower() in ("that", "which", "in", "on")
                    and number > begin
                    and self._low(number + 1) in ("is", "'s", "the", "are", "lies")
                    and word.text.lower() == "that"
                ):
                    continue
                break
            last = number + 1
        return max(last, begin)

    def _order_end(self, begin: int) -> int:
        for number in range(begin + 1, len(self.words)):
            sign = self._low(number)
            if sign in (".", "!", "?", ";", ":", ",") or (
                sign in ("but", "then") or (sign == "and" and self._is_order(number + 1) and False)
            ):
                return number
        return len(self.words) if begin < len(self.words) else begin

    # ------------------------------------------------------------- deeds

    def _deeds(self) -> tuple[Form, list[SaidDeed]]:
        """Read what is to be done, and what form the sentence has by that."""
        verbs = self._verb_places()
        orders = [n for n, _ in verbs]
        if not orders:
            return self._verbless()
        deeds: list[SaidDeed] = []
        for place, (number, subject) in enumerate(verbs):
            if number in self.taken:
                continue
            end = orders[place + 1] if place + 1 < len(orders) else len(self.words)
            found = self._deed(number, end, subject, deeds)
            if found == "statement" or found == "teaching":
                if place == 0 and len(verbs) == 1:
                    return found, []
                continue
            if isinstance(found, SaidDeed):
                deeds.append(found)
                deeds += [
                    replace(found, things=tuple(things), place=place)
                    for things, place in self._others
                ]
            self._others = []
        if not deeds and not self.forbidden and not self.exclusions:
            return self._statement_form(), []
        deeds = _sharing(deeds)
        about = [*self.before, *(one.thing for one in self.conditions if one.thing is not None)]
        return "errand", _with_antecedents(deeds, about)

    def _statement_form(self) -> Form:
        if not self.alone:
            kept = set(self.taken)
            self.alone = [one for _, one in self._mentions(range(len(self.words)))]
            self.taken = kept
        words = {self._low(n) for n in range(len(self.words))}
        taught = words & _HABIT or words & {
            "remember",
            "called",
            "named",
            "mine",
            "belongs",
            "belong",
            "lives",
            "live",
        }
        return "teaching" if taught else "statement"

    def _verb_places(self) -> list[tuple[int, int | None]]:
        """Return the numbers of verbs that may be orders or tell of one, each with its subject."""
        found: list[tuple[int, int | None]] = []
        table, _ = _verbs()
        for number, word in enumerate(self.words):
            low = word.text.lower()
            if number in self.taken or not low[0].isalpha():
                continue
            if low == "lights" or (word.tag == "VBG" and self.words[word.head].lemma in _NEEDS):
                continue
            if word.dep in ("ccomp", "xcomp") and word.head != number and self._wishes(word.head):
                continue
            if word.dep == "relcl" and not (self._starts_clause(number) and low in table):
                continue
            if (
                self._low(number - 1) in ("you", "we")
                or self._low(number - 2) in ("you", "we")
                and self._low(number - 1) in ("just", "have", "first")
            ):
                if not self._starts_clause(number):
                    continue
            subject = next(
                (
                    n
                    for n, w in enumerate(self.words)
                    if w.head == number
                    and n != number
                    and w.dep.startswith(("nsubj", "expl", "csubj"))
                ),
                None,
            )
            starts = self._starts_clause(number)
            verb_tag = word.tag.startswith("VB") and word.dep not in (
                "amod",
                "aux",
                "auxpass",
                "compound",
            )
            known = low in table or word.lemma in table
            if low in _AUX or (low in _BE and word.dep != "ROOT"):
                if (
                    low in _BE | {"have"}
                    and verb_tag
                    and word.dep in ("ROOT", "ccomp", "conj", "advcl")
                    and subject is not None
                ):
                    found.append((number, subject))
                continue
            if (
                self._low(number - 1)
                in (
                    "the",
                    "a",
                    "an",
                    "my",
                    "your",
                    "his",
                    "her",
                    "our",
                    "some",
                    "this",
                    "that",
                    "all",
                    "every",
                    "each",
                )
                and word.tag != "VBP"
            ):
                if not (verb_tag and subject is not None):
                    continue
            if starts and known:
                found.append(
                    (number, subject if subject is not None and subject < number else None)
                )
            elif verb_tag and word.tag in ("VB", "VBP", "VBZ", "VBD", "VBN", "VBG"):
                if (
                    word.tag in ("VBN", "VBG")
                    and subject is None
                    and word.dep in ("acl", "amod", "prep", "pcomp", "pobj")
                    and not starts
                ):
                    continue
                found.append((number, subject))
        return found

    def _wishes(self, verb: int) -> bool:
        """Return whether a verb says what somebody wants or needs."""
        return self.words[verb].lemma in _NEEDS and self._has_subject(verb)

    def _starts_clause(self, number: int) -> bool:
        before = number - 1
        while before >= 0 and (
            before in self.gone
            or self._low(before)
            in (
                "please",
                "just",
                "now",
                "then",
                "and",
                "or",
                "also",
                "to",
                "kindly",
                "quickly",
                "carefully",
                "gently",
                "so",
                "but",
            )
        ):
            if self._low(before) in ("and", "or") and before not in self.gone:
                following = self._low(number + 1)
                noun_before = self.words[before - 1].tag.startswith("NN") if before else False
                ends = number + 1 >= len(self.words) or self.words[number + 1].tag in (
                    "IN",
                    ".",
                    ",",
                    "CC",
                    "VBZ",
                    "VBP",
                    "MD",
                )
                return (
                    not (noun_before and ends and following not in ("up", "out", "off"))
                    or self.words[number].tag == "VB"
                )
            before -= 1
        return (
            before < 0
            or self.words[before].text in (",", ":", ";", ".", "-", "!")
            or before in self.gone
        )

    def _deed_at(self, number: int) -> tuple[str, str, int]:
        """Return the deed of the verb here, its text, and how many words it has."""
        table, _ = _verbs()
        word = self.words[number]
        lemmas = dict.fromkeys((word.lemma, word.text.lower(), _base(word.text.lower())))
        following = self._low(number + 1)
        for lemma in lemmas:
            if (
                following in word_lists().particles | {"for", "at"}
                and f"{lemma} {following}" in table
            ):
                text = f"{lemma} {following}"
                if (
                    table[text] not in ("put",)
                    or not self._begins_noun(number + 2)
                    or following in ("down", "back", "away", "over")
                ):
                    if not (
                        following in ("on", "in")
                        and lemma in ("put", "set", "get")
                        and self._begins_noun(number + 2)
                        and self._place_after(number + 2)
                    ):
                        return table[text], text, 2
        for lemma in lemmas:
            if lemma in table:
                return table[lemma], lemma, 1
        for lemma in lemmas:
            if any(text.startswith(f"{lemma} ") for text in table):
                return "", lemma, 1
        return "", word.lemma, 1

    def _place_after(self, number: int) -> bool:
        """Return whether what begins here is a place, so that "on" is no particle."""
        end = self._phrase_end(number)
        found = [one for _, one in self._mentions(range(number, end))]
        return any(
            object_types()[kind].can("receptacle") and not object_types()[kind].can("toggleable")
            for one in found
            for kind in one.types
        )

    def _begins_noun(self, number: int) -> bool:
        return number < len(self.words) and (
            self.words[number].tag in ("DT", "PRP$", "CD", "PDT", "PRP")
            or self.words[number].tag.startswith(("NN", "JJ"))
        )

    def _deed(
        self, number: int, end: int, subject: int | None, before: Sequence[SaidDeed]
    ) -> "SaidDeed | Form | None":
        """Read one verb with what goes with it."""
        word = self.words[number]
        low, lemma = word.text.lower(), word.lemma
        table, states = _verbs()
        if subject is not None:
            return self._told(number, end, subject)
        if lemma in ("use", "using"):
            self.unread.append(low)
            return None
        deed, text, size = self._deed_at(number)
        if lemma in ("make", "get", "keep", "leave", "set", "turn", "have") or lemma == "let":
            kept = self._made_so(number, end, deed)
            if kept is not None:
                return kept if isinstance(kept, SaidDeed) else None
        if not deed and size == 1:
            found = self._particle_later(number, end)
            if found:
                deed, text = found
        elif size == 1 and (found := self._particle_later(number, end)):
            deed, text = found
        if (
            not deed
            and (lemma in _SMALL_VERBS or low in _SMALL_VERBS)
            and lemma not in ("do", "say", "tell", "check", "reach", "sit", "stand", "lie")
        ):
            return None
        self.taken.update(range(number, number + size))
        things, place = self._split(range(number + size, end), deed)
        if deed == "make":
            deed = "coffee" if any("coffee" in self._low(n) for n in range(number, end)) else ""
        if (
            deed == "throw"
            and place is not None
            and place.types
            and "GarbageCan" not in place.types
        ):
            deed = "put"
        if deed == "clear" and things:
            at = things[0]
            things = [
                Mention(
                    text=f"everything on the {at.text}",
                    start=at.start,
                    end=at.end,
                    anything=True,
                    every=True,
                    at=at.types,
                )
            ]
            deed = "put"
        if deed == "go":
            things, place = ([place] if place is not None else things), None
        if deed == "take":
            deed = "put" if place is not None else "take"
            if (
                text in ("find", "locate", "look for", "search for", "show", "hunt")
                and place is None
            ):
                deed = "find"
        if deed == "put" and place is None and text in ("get rid", "rid"):
            deed = "throw"
        if deed == "fill" and any("coffee" in self._low(n) for n in range(number, end)):
            deed = "coffee"
        if deed == "water":
            deed = "fill" if any("HousePlant" in one.types for one in things) else ""
        if not deed:
            self.unread.append(text)
        near = self._near
        return SaidDeed(
            verb=text, deed=deed, start=word.start, things=tuple(things), place=place, near=near
        )

    def _particle_later(self, number: int, end: int) -> tuple[str, str] | None:
        """Return deed and verb of "turn the lamp on", where the particle stands behind its object."""
        table, _ = _verbs()
        lemma = self.words[number].lemma
        lemmas = dict.fromkeys((lemma, self._low(number), _base(self._low(number))))
        for at in range(number + 2, end):
            low = self._low(at)
            if at in self.taken or low not in word_lists().particles:
                continue
            follows = (
                at + 1 >= end
                or not self._begins_noun(at + 1)
                or self._low(at + 1) in ("and", "then")
            )
            for one in lemmas:
                if (
                    f"{one} {low}" in table
                    and (follows or low in ("away", "out"))
                    and self._low(at + 1) != "of"
                ):
                    self.taken.add(at)
                    return table[f"{one} {low}"], f"{one} {low}"
        return None

    def _made_so(self, number: int, end: int, deed: str) -> SaidDeed | bool | None:
        """Read "make it hot", "leave the lamp on", "leave it alone"; None where it is neither."""
        _, states = _verbs()
        lemma = self.words[number].lemma
        mentions = [one for _, one in self._mentions(range(number + 1, end))]
        tail = [self._low(n) for n in range(number + 1, end) if self._low(n).isalpha()]
        if lemma in ("leave", "keep", "let") and mentions:
            text = " ".join(tail)
            alone = re.search(
                r"\b(?:alone|as (?:it|they) (?:is|are)|where (?:it|they) (?:is|are)|be|in peace|untouched|running)\b",
                text,
            )
            state = tail[-1] if tail and tail[-1] in states else ""
            if alone or state or (lemma == "leave" and not self._has_place(number + 1, end)):
                self.exclusions += [one for one in mentions if one.types]
                begin = number - 1 if self._low(number - 1) in ("and", "but", ",") else number
                self._drop(begin, end)
                return True
            return None
        if (
            lemma in ("make", "get", "turn", "set")
            and tail
            and tail[-1] in states
            and mentions
            and deed in ("make", "take", "put", "")
        ):
            if lemma in ("get", "set", "turn") and tail[-1] in ("on", "off", "out", "down", "up"):
                return None
            self.taken.update(range(number, end))
            return SaidDeed(
                verb=f"{lemma} {tail[-1]}",
                deed=states[tail[-1]],
                start=self.words[number].start,
                things=tuple(mentions[:1]),
            )
        return None

    def _has_place(self, begin: int, end: int) -> bool:
        return any(
            self._low(n) in _DESTINATIONS and self._begins_noun(n + 1) for n in range(begin, end)
        )

    def _told(self, number: int, end: int, subject: int) -> "SaidDeed | Form | None":
        """Read a verb that has a subject: a wish, a need, or a statement."""
        _, states = _verbs()
        word = self.words[number]
        low, lemma, who = word.text.lower(), word.lemma, self._low(subject)
        helpers = {
            w.text.lower()
            for w in self.words
            if w.head == number and w.dep in ("aux", "auxpass", "neg")
        }
        begin = self._phrase_begin(subject)
        about = [one for _, one in self._mentions(range(begin, number))]
        habit = any(self._low(n) in _HABIT for n in range(len(self.words)))
        if who in ("you", "u", "ya") and helpers & {
            "should",
            "must",
            "can",
            "could",
            "may",
            "might",
        }:
            return self._deed(number, end, None, ())
        if (
            who in ("i", "we")
            and lemma in _NEEDS | {"have"}
            and not helpers & {"n't", "not", "did"}
        ):
            things, place = self._split(range(number + 1, end), "put")
            self.taken.update(n for n in range(number + 1, end) if self._low(n) in ("moved", "put", "placed", "brought", "set", "to", "be"))
            done = next((n for n in range(number + 1, end) if self.words[n].tag in ("VBN", "VBD") and n - 1 != number and self._deed_at(n)[0] not in ("", "put")), None)
            if done is not None and things:
                self.taken.update(range(begin, end))
                return SaidDeed(verb=low, deed=self._deed_at(done)[0], start=word.start, things=tuple(things))
            state = next(
                (
                    states[self._low(n)]
                    for n in range(number + 1, end)
                    if self._low(n) in states
                    and self.words[n].dep != "amod"
                    and not self._begins_noun(n + 1)
                ),
                "",
            )
            if lemma == "have":
                return "statement"
            self.taken.update(range(begin, end))
            if not things:
                return None
            if state and place is None:
                return SaidDeed(verb=low, deed=state, start=word.start, things=tuple(things))
            return SaidDeed(
                verb=low,
                deed="put" if place is not None else "take",
                start=word.start,
                things=tuple(things),
                place=place,
                near=self._near,
            )
        needed = lemma in ("need", "want", "require") and who not in (
            "i",
            "we",
            "you",
            "he",
            "she",
            "they",
        )
        asked = (
            bool(helpers & {"should", "must", "can", "could", "ought", "may"})
            or needed
            or low in ("should", "has to")
        )
        wished = (
            (low in ("were", "was", "went", "be", "stood") or helpers & {"were", "was"})
            and any(self._low(n) == "if" for n in range(begin))
            and self._would_be_nice(next(n for n in range(begin) if self._low(n) == "if"))
        )
        moves = (
            lemma in ("go", "belong")
            and not habit
            and who not in ("i", "we", "you", "he", "she", "they", "it")
            and not helpers & {"did", "will"}
            and word.tag in ("VBZ", "VBP", "VB")
        )
        if lemma == "belong" and not self._later_put(end):
            moves = False
        if (
            not (asked or wished or moves)
            or habit
            or who in ("i", "we", "he", "she", "they")
            or not about
        ):
            return self._statement_form()
        after = range(number + 1, end)
        deed, text, size = self._deed_at(number)
        water = {self._low(n) for n in after}
        self.taken.update(range(begin, number + 1))
        _, place = self._split(after, "put")
        if needed or low in ("be", "were", "was", "go", "went") or lemma in ("be", "go", "belong"):
            ing = next(
                (
                    self._deed_at(n)[:2]
                    for n in after
                    if self.words[n].tag in ("VBG", "VBN", "VB") and self._deed_at(n)[0]
                ),
                None,
            )
            state = next((states[self._low(n)] for n in after if self._low(n) in states), "")
            if needed and "water" in water and any("HousePlant" in one.types for one in about):
                deed = "fill"
            elif ing and ing[0] and place is None:
                deed = ing[0]
            elif place is not None:
                deed = "put"
            elif state:
                deed = state
            else:
                return self._statement_form()
        self.taken.update(after)
        return SaidDeed(
            verb=text,
            deed=deed,
            start=word.start,
            things=tuple(about[:3]),
            place=place,
            near=self._near,
        )

    def _later_put(self, end: int) -> bool:
        return any(self._is_order(n) for n in range(end, len(self.words)))

    def _phrase_begin(self, number: int) -> int:
        """Return the first word of the phrase that has this head."""
        begin = number
        while (
            begin > 0
            and self._hangs_on(begin - 1, number)
            and self.words[begin - 1].text not in (",", ";", ":")
        ):
            begin -= 1
        return begin

    def _hangs_on(self, number: int, head: int) -> bool:
        for _ in range(12):
            if number == head:
                return True
            following = self.words[number].head
            if following == number:
                return False
            number = following
        return False

    def _verbless(self) -> tuple[Form, list[SaidDeed]]:
        """Read "all lights off" and "remotes on the armchair"; a thing alone is incomplete."""
        open_ = self._open()
        body = range(open_[0], open_[-1] + 1) if open_ else range(0)
        mentions = [one for _, one in self._mentions(body)]
        if not mentions:
            if self.exclusions or self.forbidden or self.times:
                return "errand", []
            return "incomplete", []
        last = self._low(open_[-1])
        _, states = _verbs()
        if last in ("on", "off") or self._low(open_[0]) in ("on", "off"):
            word = last if last in ("on", "off") else self._low(open_[0])
            self.taken.update(body)
            return "errand", [
                SaidDeed(
                    verb=word, deed=word, start=self.words[open_[0]].start, things=tuple(mentions)
                )
            ]
        things, place = self._split(body, "put")
        if things and place is not None:
            self.taken.update(body)
            return "errand", [
                SaidDeed(
                    verb="put",
                    deed="put",
                    start=self.words[open_[0]].start,
                    things=tuple(things),
                    place=place,
                )
            ]
        self.alone = mentions
        return "incomplete", []

    # ------------------------------------------------------------- things and places

    _near: bool = False
    _others: list[tuple[list[Mention], Mention | None]] = field(default_factory=list)

    def _split(self, body: range, deed: str) -> tuple[list[Mention], Mention | None]:
        """Return the things and the place that go with a deed; of several pairs the first."""
        groups = self._groups(body, deed)
        self._others = groups[1:]
        return groups[0]

    def _groups(self, body: range, deed: str) -> list[tuple[list[Mention], Mention | None]]:
        """Return things with their places: "the mug on the desk and the pen in the drawer"."""
        self._near = False
        found: list[_Group] = [_Group()]
        for number, one in self._mentions(body):
            group, before = found[-1], self._preposition(number, body.start)
            if before in _TOOLS:
                self._read_tool(number, one, deed)
            elif self._low(number) in _ME and before in ("", "to", "for"):
                continue
            elif self._is_you(number):
                continue
            elif before in _SOURCES or self._is_relative(number, body.start):
                group.told_by(one, deed)
            elif before in _DESTINATIONS and not (deed == "look" and before == "at"):
                if deed not in ("put", "take") and group.things:
                    group.told_by(one, deed)
                else:
                    self._near = self._near or before in _NEAR
                    group.places.append(one)
            elif before in _IGNORED and before != "of" and group.things:
                self._ignored(number, one, before)
            elif one.text in ("water", "soap") and deed in ("wash", "fill") and not one.at and group.things:
                continue
            elif group.places and deed == "put":
                if self._listed(number) and group.things:
                    found.append(_Group([one]))
                else:
                    self.unread.append(one.text)
            else:
                group.things.append(one)
        self._somewhere(body, deed, found[-1])
        pairs = [group.pair(deed) for group in found]
        if len(pairs) > 1 and pairs[-1][1] is None:
            pairs[-1] = (pairs[-1][0], pairs[-2][1])
        return pairs

    def _is_you(self, number: int) -> bool:
        """Return whether a phrase begins a clause of what was done: "the cup you washed"."""
        return self._low(number) in ("you", "i", "we")

    def _ignored(self, number: int, one: Mention, before: str) -> None:
        if before == "for" and not one.types:  # "for breakfast", "for my guests"
            return
        if before in ("as", "like", "than"):
            self.unread.append(one.text)

    def _read_tool(self, number: int, one: Mention, deed: str) -> None:
        """Read what a thing is done with; what is no tool for it is not understood."""
        known = {
            "slice": ("Knife", "ButterKnife"),
            "wash": ("DishSponge", "SoapBottle", "SoapBar", "Cloth", "ScrubBrush", "Faucet"),
        }
        if set(one.types) & set(known.get(deed, ())) or one.text in (
            "water",
            "coffee",
            "care",
            "hand",
            "hands",
        ):
            return
        self.unread.append(f"with {one.text}")

    def _somewhere(self, body: range, deed: str, group: "_Group") -> None:
        """Read "there" and "where the newspaper is" as the place of a thing."""
        if group.places or deed not in ("put", "take"):
            return
        for number in body:
            low = self._low(number)
            if low in _WHERE_ELSE and number not in self.taken and deed == "put":
                self.taken.add(number)
                group.places.append(
                    Mention(
                        text=low,
                        start=self.words[number].start,
                        end=self.words[number].end,
                        vague=True,
                    )
                )
                return
            if low in ("in", "inside") and deed == "put" and number == body.stop - 1 - (self.words[body.stop - 1].text in ".!?,;"):
                self.taken.add(number)
                group.places.append(Mention(text="there", start=self.words[number].start, end=self.words[number].end, vague=True))
                return
            if low == "where" and number not in self.gone:
                words = self.words[number : body.stop]
                self.taken.update(range(number, body.stop))
                text = self.text[words[0].start : words[-1].end].rstrip(" .,!?")
                group.things = [one for one in group.things if one.start < words[0].start]
                group.places.append(
                    Mention(text=text, start=words[0].start, end=words[-1].end, told=True)
                )
                return

    def _listed(self, number: int) -> bool:
        before = number - 1
        while before >= 0 and self.words[before].tag in ("DT", "PRP$", "CD", "PDT", "JJ", "NN"):
            before -= 1
        return self._low(before) in ("and", ",", "or")

    def _preposition(self, number: int, least: int) -> str:
        """Return the preposition that a phrase beginning here stands behind; "" for none."""
        before = number - 1
        while before >= least and self._low(before) in ("both", "all", "up", "down"):
            before -= 1
        if before < least:
            return ""
        word, earlier = self._low(before), self._low(before - 1)
        if word == "of":
            return {"out": "out", "off": "off", "top": "on", "front": "near", "inside": "in"}.get(
                earlier, "of"
            )
        if word == "to" and earlier in ("next", "close"):
            return "near"
        known = _DESTINATIONS | _SOURCES | _TOOLS | _IGNORED
        return word if word in known else ""

    def _is_relative(self, number: int, least: int) -> bool:
        """Return whether a place only says which thing is meant: "the egg that is on the counter"."""
        at = number - 1
        while at >= least and (self._low(at) in _DESTINATIONS | {"the", "of", "top"}):
            at -= 1
        return at >= least and (
            self._low(at)
            in (
                "is",
                "are",
                "'s",
                "lies",
                "lie",
                "lying",
                "stands",
                "sits",
                "was",
                "were",
                "sitting",
            )
            and self._low(at - 1)
            in ("that", "which", "everything", "whatever", "what", "all", *_ANYTHING)
            or self._low(at) in ("lying", "sitting", "standing")
        )

    def _mentions(self, body: range) -> list[tuple[int, Mention]]:
        """Return the noun phrases of some words, each with the number of its first word."""
        found: list[tuple[int, Mention]] = []
        number = body.start
        while number < body.stop:
            if number in self.taken and number in self.gone:
                number += 1
                continue
            end = self._noun_end(number, body.stop)
            if end == number:
                number += 1
                continue
            one = self._mention(number, end)
            if one is None and self._low(end - 1) in _ROOMS:
                self.taken.update(range(number, end))
            if one is not None:
                clause = self._done_before(end, body.stop)
                if clause > end:
                    one = replace(one, told=one.vague or one.told, vague=False)
                    self.taken.update(range(number, clause))
                    found.append((number, one))
                    number = clause
                    continue
                found.append((number, one))
                self.taken.update(range(number, end))
            number = end
        return found

    def _done_before(self, number: int, stop: int) -> int:
        """Return where a clause like "(that) you just washed" ends; the same number if none is."""
        at = number + (self._low(number) in ("that", "which"))
        if self._low(at) not in ("you", "i", "we"):
            return number
        for end in range(at + 1, min(at + 5, stop)):
            if self.words[end].tag in ("VBD", "VBN", "VBP", "VB") and self._low(end) not in _AUX:
                return end + 1 + (self._low(end + 1) in word_lists().particles)
        return number

    def _noun_end(self, number: int, stop: int) -> int:
        """Return the end of the noun phrase that begins here; the same number if none does."""
        at, head = number, number
        while at < stop and at not in self.gone:
            word = self.words[at]
            low = word.text.lower()
            if low in _WHERE_ELSE or low in ("then", "that", "which") and at > number:
                break
            if low in (
                "all",
                "both",
                "each",
                "every",
                "half",
                "any",
                "some",
                "no",
                "another",
                "what",
                "whatever",
            ) or word.tag in ("DT", "PRP$", "PDT", "CD", "WP"):
                if head > number:
                    break
                if low in (
                    "everything",
                    "anything",
                    "whatever",
                    "this",
                    "that",
                    "these",
                    "those",
                    "all",
                    "both",
                    "one",
                ):
                    following = self.words[at + 1] if at + 1 < stop else None
                    relative = following is not None and following.text.lower() in ("that", "which")
                    if (
                        relative
                        or following is None
                        or not following.tag.startswith(("NN", "JJ", "CD", "DT", "PRP$", "VBN"))
                        and low != "all"
                    ):
                        if (
                            relative
                            or low not in ("all", "both")
                            or following is None
                            or following.text.lower() in ("that", "of", "lies", "on", "in")
                        ):
                            head = at + 1
                at += 1
            elif word.tag in ("PRP", "NN", "NNS", "NNP", "NNPS") or word.tag == "FW":
                if low in _ME or low in ("i", "you", "we", "u", "he", "she"):
                    return number if at == number else (head if head > number else number)
                if word.tag == "PRP" and head > number:
                    break
                head = at + 1
                at += 1
                if word.tag == "PRP":
                    break
            elif word.tag == "POS" or word.text in ("'s", "’s"):
                at += 1
            elif (
                word.tag in ("JJ", "JJR", "JJS", "VBN", "VBG", "VBD")
                and (at > number or word.tag == "JJ")
                and self._noun_follows(at, stop)
            ):
                at += 1
            elif low == "of" and head == at and self._measure(number, at):
                at += 1
            elif low in ("-", "and") and head == at and low == "-":
                at += 1
            elif (
                head == at
                and word.tag.startswith(("VB", "JJ", "RP"))
                and self.lexicon.named(self._phrase(number, at + 1))
            ):
                head = at + 1
                at += 1
            else:
                break
        return head

    def _noun_follows(self, at: int, stop: int) -> bool:
        for number in range(at + 1, min(at + 4, stop)):
            if self.words[number].tag.startswith("NN"):
                return True
            if self.words[number].tag not in ("JJ", "VBN", "VBG", "CD", "HYPH", "CC"):
                return False
        return False

    def _measure(self, begin: int, at: int) -> bool:
        """Return whether "of" leads to what is meant: "a slice of bread", "all of the cups"."""
        head = self._low(at - 1)
        return head in word_lists().measures | {
            "all",
            "both",
            "each",
            "mug",
            "cup",
            "couple",
            "lot",
            "bars",
            "rolls",
            "one",
            "two",
            "three",
        }

    def _phrase(self, begin: int, end: int) -> str:
        return self.text[self.words[begin].start : self.words[end - 1].end].lower()

    def _mention(self, begin: int, end: int) -> Mention | None:
        """Read one noun phrase."""
        first, last = self.words[begin].start, self.words[end - 1].end
        lows = [self._low(n) for n in range(begin, end)]
        number: int | None = None
        every = False
        start = begin
        while start < end:
            low, tag = self._low(start), self.words[start].tag
            if low in _EVERY:
                every = True
                if low == "both":
                    number = 2
            elif low in _NUMBERS or low.isdigit():
                number = int(low) if low.isdigit() else _NUMBERS[low] if _NUMBERS[low] else number
            elif low == "of" or low in word_lists().measures and "of" in lows[start - begin :]:
                if low == "rest":
                    return Mention(text=" ".join(lows), start=first, end=last, vague=True)
            elif tag not in ("DT", "PRP$", "PDT", "POS", "WP", "CD") and low not in ("'s", "’s"):
                break
            start += 1
        if start >= end:
            if lows[-1] in _VAGUE:
                return Mention(text=lows[-1], start=first, end=last, vague=True)
            if lows[-1] in _ANYTHING | {"both"}:
                return Mention(
                    text=" ".join(lows),
                    start=first,
                    end=last,
                    anything=lows[-1] != "both",
                    vague=lows[-1] == "both",
                    every=True,
                )
            return None
        if "of" in lows[start - begin :] and self._low(start) in (
            "mug",
            "cup",
            "bars",
            "rolls",
            "couple",
            "lot",
            "one",
            "two",
            "three",
        ):
            inner = lows.index("of", start - begin) + begin + 1
            body = self._mention(inner, end)
            if body is not None and (body.types or self._low(start) not in ("mug", "cup")):
                many = self._low(start) in ("bars", "rolls")
                return replace(
                    body,
                    start=first,
                    end=last,
                    number=number or body.number or (2 if self._low(start) == "couple" else None),
                    every=every or many and number is None,
                )
            end = inner - 1
        words = [self._low(n) for n in range(start, end)]
        if "'s" in words or "’s" in words:
            at = max(n for n, one in enumerate(words) if one in ("'s", "’s"))
            words, start = words[at + 1 :], start + at + 1
        if not words:
            return None
        text = " ".join(words)
        head = words[-1]
        if head in _ANYTHING and len(words) <= 2:
            every_thing = head in ("everything", "all", "whatever", "lot") or every
            return Mention(
                text=text,
                start=first,
                end=last,
                anything=every_thing,
                vague=not every_thing,
                every=every_thing,
            )
        types = self._types(words, start)
        if not types and (head in _VAGUE or text in _VAGUE):
            return Mention(text=text, start=first, end=last, vague=True)
        if not types and head in _ROOMS:
            return None
        plural = self.words[end - 1].tag in ("NNS", "NNPS") and not every and number is None
        if (
            plural
            and types
            and self.lexicon.named(singular(text)) == types
            and singular(text) != text
            and not self._own_plural(head)
        ):
            every = True
        return Mention(text=text, start=first, end=last, types=types, number=number, every=every)

    def _own_plural(self, head: str) -> bool:
        """Return whether a plural names one thing: keys, blinds, lights, paper towels."""
        return head in (
            "keys",
            "blinds",
            "curtains",
            "lights",
            "towels",
            "taps",
            "drapes",
            "scissors",
            "glasses",
            "tissues",
            "bins",
            "dishes",
        )

    def _types(self, words: Sequence[str], start: int) -> tuple[str, ...]:
        """Return the types that a phrase names, adjectives left out one by one."""
        if len(words) > 1 and words[-1] in _STATES and not self.lexicon.named(" ".join(words)):
            words = words[:-1]
        for first in range(len(words)):
            phrase = " ".join(words[first:])
            found = self.lexicon.named(phrase)
            if found:
                return found
            tag = self.words[min(start + first, len(self.words) - 1)].tag
            known_word = words[first] in _DROPPED or words[first] in word_lists().qualifiers
            if not (
                known_word
                or tag
                in ("JJ", "JJR", "JJS", "VBN", "VBG", "VBD", "CD", "NNP", "POS", "RB", "DT", "FW")
            ):
                return ()
            if tag in ("NNP", "FW") and not known_word and first == len(words) - 1:
                return ()
        return ()

    # ------------------------------------------------------------- what is left

    def _lacking(self, deeds: Sequence[SaidDeed]) -> str:
        """Return what an errand lacks; "" where it is whole."""
        last = [n for n in self._all_words() if n not in self.gone]
        if last:
            end = self.words[last[-1]]
            if end.tag in ("DT", "PRP$", "PDT", "CC") or (
                end.tag == "TO"
                or end.text.lower()
                in ("the", "a", "an", "my", "to", "with", "into", "onto", "from", "and")
            ):
                return "what"
            if end.tag == "IN" and end.text.lower() not in (
                "on",
                "off",
                "in",
                "out",
                "up",
                "down",
                "away",
                "over",
                "back",
            ):
                return "where"
            if (
                end.text.lower() in ("on", "in")
                and deeds
                and deeds[-1].deed in ("put",)
                and deeds[-1].place is None
            ):
                return "where"
        for deed in deeds:
            if deed.deed in ("", "wait"):
                continue
            if not deed.things and deed.deed not in ("coffee", "go", "clear"):
                return "what"
            if any(one.vague and not one.at for one in deed.things):
                return "what"
            if deed.place is not None and deed.place.vague:
                return "where"
            if (
                deed.deed == "put"
                and deed.place is None
                and deed.verb.split()[0] in _NEEDS_PLACE
                and len(deed.verb.split()) == 1
            ):
                return "where"
        return ""

    def _all_words(self) -> list[int]:
        return [n for n, w in enumerate(self.words) if w.text[0].isalnum()]

    def _read_rest(self) -> None:
        """Keep the content words that nothing was made of."""
        for number in self._open():
            word = self.words[number]
            low = word.text.lower()
            if (
                number in self.taken
                or word.dep == "relcl"
                or low in _NEVER_MIND
                or low in _DESTINATIONS | _SOURCES | _TOOLS | _IGNORED
                or low in _AUX | _BE | _SMALL_VERBS | _ME | _WHERE_ELSE
            ):
                continue
            if word.tag in (
                "RB",
                "JJ",
                "JJR",
                "UH",
                "CC",
                "DT",
                "IN",
                "TO",
                "MD",
                "PRP",
                "PRP$",
                "WDT",
                "WP",
                "WRB",
                "RP",
                "EX",
                "POS",
                "PDT",
                ".",
                ",",
                "HYPH",
            ):
                continue
            self.unread.append(low)


def _going_on(request: Request, last: Sequence[SaidDeed]) -> Request:
    """Return "the soap bottle too" as the deed before it, done to that."""
    goes_on = re.search(r"\b(?:too|also|as well|likewise)\b", request.text, re.IGNORECASE)
    if request.form != "incomplete" or not (goes_on and last and request.alone):
        return request
    return replace(request, form="errand", lacking="", deeds=(replace(last[0], things=request.alone),))


def _base_of_deed(word: str) -> str:
    """Return the base of a verb that asks for something, "" for any other word."""
    verbs = _verbs()[0]
    firsts = {text.split()[0] for text in verbs}
    past = {"put": "put", "taken": "take", "made": "make", "brought": "bring", "cut": "cut", "shut": "shut", "thrown": "throw", "set": "set"}
    found = past.get(word) or (word if word in firsts else _base(word))
    return found if found in firsts else ""


def _is_deed(word: str) -> bool:
    """Return whether a word is a form of a verb that asks for something."""
    verbs = _verbs()[0]
    firsts = {text.split()[0] for text in verbs}
    return (word in firsts or _base(word) in firsts or _base(word) in verbs) and word not in ("go", "run", "come", "make", "find", "show", "leave", "like", "start", "use", "need", "want") or word in ("make", "making", "bring", "find", "leave")


def _base(word: str) -> str:
    """Return a verb's base for forms that a tagger may not see as such."""
    for ending, instead in (
        ("ing", ""),
        ("ing", "e"),
        ("ed", ""),
        ("ed", "e"),
        ("es", ""),
        ("s", ""),
    ):
        stem = f"{word.removesuffix(ending)}{instead}"
        if word.endswith(ending) and any(text.split()[0] == stem for text in _verbs()[0]):
            return stem
        if word.endswith(ending) and f"{word.removesuffix(ending)}{instead}" in _verbs()[0]:
            return f"{word.removesuffix(ending)}{instead}"
    return word


def _of_what(forbidden: SaidDeed, deeds: Sequence[SaidDeed]) -> SaidDeed:
    """Return a forbidden deed whose "it" stands for all that the others are about."""
    named = [
        one for deed in deeds for one in (*deed.things, *((deed.place,) if deed.place else ()))
    ]
    if any(not one.types and not one.vague for one in forbidden.things):
        return replace(forbidden, things=())  # "the door": any
    if not forbidden.things or all(one.vague for one in forbidden.things):
        anything = any(one.text in ("anything", "nothing") for one in forbidden.things)
        return replace(forbidden, things=() if anything else tuple(named))
    return forbidden


_NEEDS_OF_A_DEED = {
    "open": "openable", "close": "openable", "on": "toggleable", "off": "toggleable",
    "slice": "sliceable", "fill": "canFillWithLiquid", "empty": "canFillWithLiquid",
    "put": "pickupable", "take": "pickupable", "throw": "pickupable", "wash": "pickupable",
    "heat": "pickupable", "cool": "pickupable",
}  # fmt: skip


def _sharing(deeds: Sequence[SaidDeed]) -> list[SaidDeed]:
    """Return deeds of which one without a thing shares that of the next: "slice and heat it"."""
    found = list(deeds)
    for number in range(len(found) - 2, -1, -1):
        if not found[number].things and found[number].deed and found[number].deed not in ("go", "coffee", "wait"):
            found[number] = replace(found[number], things=found[number + 1].things)
    return found


def _with_antecedents(deeds: Sequence[SaidDeed], before: Sequence[Mention]) -> list[SaidDeed]:
    """Return deeds whose "it" and "them" stand for what was named before.

    Args:
        deeds: in their order.
        before: what was named ahead of them, in a condition.
    """
    found: list[SaidDeed] = []
    named: list[Mention] = list(before)
    last: tuple[Mention, ...] = tuple(before[-1:])
    for deed in deeds:
        cleared = found[-1] if found and found[-1].verb.startswith("clear") else None
        loose = all(one.vague or one.anything for one in deed.things)
        if (
            cleared is not None
            and cleared.place is None
            and deed.deed == "put"
            and loose
            and deed.place
        ):
            found[-1] = replace(cleared, place=deed.place)
            continue
        things: list[Mention] = []
        for one in deed.things:
            if one.vague and one.text in ("them", "both", "these", "they") and last:
                things += [replace(thing, at=()) for thing in last]
            elif one.vague and one.text in ("it", "this", "that") and named:
                things.append(replace(_suited(named, deed.deed), at=()))
            else:
                things.append(one)
        place = deed.place
        if place is not None and place.vague and place.text in ("it", "that", "there") and named:
            holds = [one for one in named if any(object_types()[k].can("receptacle") for k in one.types)]
            place = next((one.place for one in reversed(found) if one.place), None)
            place = place or (holds or named)[-1]
        found.append(replace(deed, things=tuple(things), place=place))
        last = tuple(one for one in things if not one.vague) or last
        named += [one for one in (*((place,) if place else ()), *things) if not one.vague]
    return found


def _suited(named: Sequence[Mention], deed: str) -> Mention:
    """Return what was named last and can be what a deed is done to; else the last."""
    wanted = _NEEDS_OF_A_DEED.get(deed, "")
    for one in reversed(named):
        if any(object_types()[kind].can(wanted) for kind in one.types if wanted):  # type: ignore[arg-type]
            return one
    return named[-1]
