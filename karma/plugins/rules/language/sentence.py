"""One sentence while it is read: its words, and which of them something was made of."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from karma.household.states import lacking
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.request_words import (
    base_of_deed,
    deed_verbs,
    is_deed,
    request_words,
)
from karma.plugins.rules.types import Mention, SaidDeed, Word

_IS = frozenset(("is", "are", "'s", "'re", "was", "were", "looks", "look"))
_WHATEVER = frozenset(("whatever", "whichever", "everything", "anything", "all"))
_STATE_LEADS = _WHATEVER | {"one", "ones", "thing", "things", "those"}
_STATE_ADVERBS = frozenset(("still", "not", "n't", "currently", "already", "now", "just", "all"))
_SIGNS = frozenset((",", ":", ";", ".", "-", "!"))
_HARD_SIGNS = frozenset((".", "!", "?", ";", ":"))


@dataclass(slots=True)
class SaidSentence:
    """A sentence being read; a word is taken once something is made of it."""

    text: str  # all that is said; words know their places in it
    words: Sequence[Word]
    lexicon: Lexicon
    before: list[Mention]  # things that were named ahead of it
    last: SaidDeed | None = None  # the deed that was asked for ahead of it
    older: Sequence[Mention] = ()  # things that were named before `before`
    taken: set[int] = field(default_factory=set)
    gone: set[int] = field(default_factory=set)  # of them, what is no part of the errand
    unread: list[str] = field(default_factory=list)
    alone: list[Mention] = field(default_factory=list)  # named without any deed
    told_so: dict[int, tuple[str, int]] = field(default_factory=dict)  # where "that is open" begins

    def __post_init__(self) -> None:
        """Find what tells things by their state, which asks for nothing."""
        for number in range(1, len(self.words)):
            state, end = self._state_clause(number)
            if state:
                self.told_so[number] = state, end
                self.taken.update(range(number, end))

    @property
    def told_so_words(self) -> set[int]:
        """The numbers of the words in clauses like "that is open"."""
        return {n for begin, (_, end) in self.told_so.items() for n in range(begin, end)}

    def _state_clause(self, number: int) -> tuple[str, int]:
        """Return the state in a clause that begins here, and its end: "that is still on"."""
        at = number + (self.low(number) in ("that", "which", "who"))
        before = self.low(number - 1)
        led = self.tag(number - 1).startswith("NN") or before in _STATE_LEADS
        if not led or (at == number and before not in _WHATEVER):
            return "", number
        left = self.low(at) in ("you", "i", "we", "they") and self.low(at + 1) == "left"
        if not (left or self.low(at) in _IS):
            return "", number
        at += 2 if left else 1
        no = False
        while self.low(at) in _STATE_ADVERBS:
            no = no or self.low(at) in ("not", "n't")
            at += 1
        state = request_words().seen.get(self.low(at), "")
        if not state or (state in ("on", "off") and self.begins_noun(at + 1)):
            return "", number
        return lacking(state) if no else state, at + 1

    def low(self, number: int) -> str:
        """Return a word in small letters, "" beyond the ends."""
        return self.words[number].text.lower() if 0 <= number < len(self.words) else ""

    def lows(self, begin: int = 0, end: int | None = None) -> list[str]:
        """Return some words in small letters."""
        stop = len(self.words) if end is None else min(end, len(self.words))
        return [self.low(n) for n in range(max(begin, 0), stop)]

    def tag(self, number: int) -> str:
        """Return a word's tag, "" beyond the ends."""
        return self.words[number].tag if 0 <= number < len(self.words) else ""

    def phrase(self, begin: int, end: int) -> str:
        """Return words as they were said."""
        return self.text[self.words[begin].start : self.words[end - 1].end]

    def left(self) -> list[int]:
        """Return the numbers of words of which nothing was made yet, signs left out."""
        return [
            n for n, w in enumerate(self.words)
            if (n not in self.taken and w.text[0].isalnum()) or w.text == "'s"
        ]  # fmt: skip

    def drop(self, begin: int, end: int) -> str:
        """Take words out of the errand; return them as they were said."""
        self.taken.update(range(begin, end))
        self.gone.update(range(begin, end))
        return self.phrase(begin, end)

    # ------------------------------------------------------------- what hangs on what

    def subject(self, verb: int) -> int | None:
        """Return the number of a verb's subject, None if it has none."""
        found = (
            n for n, w in enumerate(self.words)
            if w.head == verb and n not in {verb, *self.gone}
            and w.dep.startswith(("nsubj", "csubj", "expl"))
        )  # fmt: skip
        return next(found, None)

    def helpers(self, verb: int) -> set[str]:
        """Return the auxiliaries and negations of a verb."""
        kinds = ("aux", "auxpass", "neg")
        return {w.text.lower() for w in self.words if w.head == verb and w.dep in kinds}

    def phrase_begin(self, number: int) -> int:
        """Return the first word of the phrase that has this head."""
        begin = number
        while begin and self._hangs_on(begin - 1, number) and self.low(begin - 1) not in _SIGNS:
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

    # ------------------------------------------------------------- verbs and clauses

    def begins_noun(self, number: int) -> bool:
        """Return whether a noun phrase may begin with this word."""
        tag = self.tag(number)
        return tag in ("DT", "PRP$", "CD", "PDT", "PRP") or tag.startswith(("NN", "JJ"))

    def is_order(self, number: int) -> bool:
        """Return whether a word is a verb that asks for something."""
        low = self.low(number)
        if not low or low in request_words().auxiliaries:
            return False
        if self.tag(number) == "VBG" and all(n in self.gone for n in range(number)):
            return is_deed(low)
        return low in deed_verbs() or (self.tag(number) == "VB" and self.subject(number) is None)

    def known_verb(self, number: int) -> bool:
        """Return whether a word is a form of a verb that asks for something."""
        word, low = self.words[number], self.low(number)
        phrase = f"{low} {self.low(number + 1)}"  # "switch on"
        return bool({low, word.lemma, phrase} & deed_verbs().keys())

    def is_bare(self, number: int) -> bool:
        """Return whether a verb that has a subject in the parse cannot tell anything of it.

        "Fry egg, toast bread, wash pan": an order, whatever was taken for its subject.
        """
        subject, helped = self.subject(number), self.helpers(number)
        bare = self.tag(number) == "VB" and not helped
        led = subject is not None and self.tag(subject) == "VB"
        return subject is not None and (bare or led) and self.starts_clause(number)

    def starts_clause(self, number: int) -> bool:
        """Return whether a word stands where an order begins."""
        before = number - 1
        if self._runs_on(number):
            return True
        small = request_words().before_verbs | request_words().sequence
        while before >= 0 and (before in self.gone or self.low(before) in small):
            if self.low(before) in ("and", "or") and before not in self.gone:
                return not self._listed_noun(before, number)
            if self.low(before) == "then" and self.tag(number) == "VB":
                return True  # "rinse the mug then put it away"
            before -= 1
        return before < 0 or self.words[before].text in _SIGNS or before in self.gone

    def _runs_on(self, number: int) -> bool:
        """Return whether an order follows the one before without a word: "slice it put it in"."""
        bare = self.tag(number) in ("VB", "VBP", "VBD") and self.known_verb(number)
        follows = self.low(number + 1) in ("it", "them") and self.tag(number - 1)[:2] == "NN"
        ordered = any(self.tag(n) == "VB" for n in range(number))
        subject = self.subject(number)
        return bare and follows and ordered and (subject is None or self.tag(subject) == "VB")

    def _listed_noun(self, joint: int, number: int) -> bool:
        """Return whether a word behind "and" is one more noun of a list, not a verb."""
        ends = self.tag(number + 1) in ("", "IN", ".", ",", "CC", "VBZ", "VBP", "MD")
        switches = self.low(number) in ("switch", "turn") and self.low(number + 1) == "on"
        particle = switches or self.low(number + 1) in ("up", "out", "off")
        noun = joint > 0 and self.tag(joint - 1).startswith("NN")
        return noun and ends and not particle and self.tag(number) != "VB"

    def clause_end(self, begin: int, *, orders: bool = True) -> int:
        """Return where a clause ends: at a sign, or before the order that follows it."""
        for number in range(begin, len(self.words)):
            if self.words[number].text in _HARD_SIGNS or self.low(number) in (",", "then"):
                return number
            if orders and number > begin + 2 and self._order_follows(number):
                return number
        return len(self.words)

    def _order_follows(self, number: int) -> bool:
        inside = self.low(number - 1) in ("to", "is", "are", "it", "been", "the")
        return self.tag(number) in ("VB", "VBP") and self.is_order(number) and not inside

    def order_end(self, begin: int) -> int:
        """Return where what goes with one verb ends: at a sign, "but" or "then"."""
        for number in range(begin + 1, len(self.words)):
            if self.words[number].text in _HARD_SIGNS or self.low(number) in (",", "but", "then"):
                return number
        return max(len(self.words), begin)

    def lemmas(self, number: int) -> tuple[str, ...]:
        """Return what may be the base form of a word."""
        word = self.words[number]
        low = word.text.lower()
        return tuple(dict.fromkeys((word.lemma, low, base_of_deed(low) or low)))
