"""An instruction string to clauses, and what each of them asks for, in AI2-THOR's types.

A clause is cut where a verb begins behind a comma or a full stop. Inside it "and <verb>" begins
another phrase: "wash the apple and slice it" is one clause of two phrases.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from karma.household.states import OPPOSITES
from karma.tasks.loose_names import (
    ANYTHING,
    IT,
    Verbs,
    mentioned,
    names,
    singular,
    state_of,
    use_in,
    verb_at,
    words_of,
)

_CUTS = r"[.;!?](?:\s|$)|,|\n|→|->|\bthen\b"
_EMPTY = ("", "and", "after that", "please")
_SEVERAL = frozenset(("both", "all", "each", "rest"))  # "serve both on a plate"
_PIECES = ("slice", "piece")
VAGUE = frozenset((ANYTHING, IT))  # hints at nothing in particular


@dataclass(frozen=True, slots=True, kw_only=True)
class Phrase:
    """One verb and what stands with it."""

    verbs: tuple[Verbs, ...]
    objects: frozenset[str]  # types named before the first destination word
    places: frozenset[str]  # types named after it
    keys: frozenset[str]  # of all names, as tables have them
    hints: frozenset[str]  # types that a vague word may mean
    meant: frozenset[str] = frozenset()  # by "it": what was spoken of last
    words: tuple[str, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether it asks to bring something somewhere."""
        return any(verb.moves for verb in self.verbs)

    @property
    def states(self) -> frozenset[str]:
        """What it brings about, or says that something is to be."""
        said = {
            state_of(" ".join(self.words[at + 1 : at + 1 + length]))
            for at, word in enumerate(self.words)
            if word in ("is", "are")
            for length in (1, 2)
        }
        done = (state for verb in self.verbs for state in verb.states)
        return frozenset((*done, *filter(None, said)))

    @property
    def described(self) -> frozenset[str]:
        """How it says that a thing is already: "the chopped lettuce", "a slice", no "dirty" mug."""
        cut = any(singular(word) in _PIECES for word in self.words)
        said = {"sliced"} if cut else set()
        said |= set(filter(None, map(state_of, self.words)))
        return frozenset(said - {OPPOSITES.get(state) for state in self.states})

    @property
    def speaks(self) -> bool:
        """Whether it names anything, if only as "food", or means what was named before."""
        return bool(self.objects or self.places or self.meant or self.hints - VAGUE)

    @property
    def does(self) -> bool:
        """Whether its verb asks for anything that a goal can say; of an unknown one who knows."""
        known = self.states or self.done_at or self.predicates
        return self.moves or bool(known) or not self.verbs

    @property
    def done_at(self) -> frozenset[str]:
        """Types of the places and appliances that go with its verb."""
        return frozenset(place for verb in self.verbs for place in verb.places)

    @property
    def predicates(self) -> frozenset[str]:
        """What its verb brings about, as goals have it."""
        return frozenset(one for verb in self.verbs for one in verb.predicates)


# ----------------------------------------------------------------- clauses


def clauses_of(text: str) -> tuple[str, ...]:
    """Return the clauses of a task's text: each begins with a verb, save perhaps the first.

    What an agent is told is cut finer, by `karma.tasks.sentences.split_instruction`.
    """
    clauses: list[str] = []
    waiting = ""
    for part in re.split(_CUTS, text, flags=re.IGNORECASE):
        part = " ".join(part.split())
        part = re.sub(r"^(?:and\s+)+|\s+and$", "", part, flags=re.IGNORECASE).strip()
        if part.lower() in _EMPTY or re.fullmatch(r"\W*\d*\W*", part):
            continue
        words = words_of(part)
        if verb_at(words, 0, first=not clauses and not waiting)[1]:
            clauses.append(f"{waiting}{part}")
            waiting = ""
        elif clauses:
            clauses[-1] += f", {part}"
        else:
            waiting += f"{part}, "
    return tuple(clauses) or (text.strip(),)


def halves(text: str) -> tuple[str, ...]:
    """Return a clause cut at its first "and <verb>"; () where there is none."""
    for match in re.finditer(r"\s+and\s+", text, flags=re.IGNORECASE):
        if verb_at(words_of(text[match.end() :]), 0)[1]:
            return text[: match.start()], text[match.end() :]
    return ()


# ----------------------------------------------------------------- phrases


def read_clauses(clauses: Sequence[str]) -> list[tuple[Phrase, ...]]:
    """Return the phrases of each clause; what "it" means runs on from one clause to the next."""
    found = []
    spoken: frozenset[str] = frozenset()
    for text in clauses:
        phrases = []
        for words in _phrases(text):
            phrase = _read(words, spoken)
            phrases.append(phrase)
            told = phrase.objects or phrase.hints - VAGUE or phrase.meant
            spoken = told | phrase.places or spoken
        found.append(tuple(phrases))
    return found


def _phrases(text: str) -> list[list[str]]:
    """Return the words of each verb of a clause; words before the first one go with it."""
    joints = names().joints
    found: list[list[str]] = []
    for part in text.split(","):
        words = words_of(part)
        used = use_in(words)[0]
        starts = [
            i
            for i in range(len(words))
            if (i == 0 or words[i - 1] in joints)
            and i not in used
            and verb_at(words, i, first=i == 0 and not found)[1]
        ]
        if not starts:
            found = [*found[:-1], [*found[-1], "and", *words]] if found else [words]
            continue
        if starts[0] and found:
            found[-1] += words[: starts[0]]
        found += [words[a:b] for a, b in zip(starts, [*starts[1:], len(words)], strict=True)]
    return found or [[]]


def _read(words: Sequence[str], spoken: frozenset[str]) -> Phrase:
    """Return what a phrase speaks of.

    Args:
        words: of one verb, or of none.
        spoken: types of what was spoken of last before it.
    """
    table = names()
    at, groups = verb_at(words, 0, first=True)
    verbs = tuple(verb for group, verb in table.verbs.items() if group in groups)
    used, useful = use_in(words)
    told = [word for i, word in enumerate(words) if i not in used]
    rest = told[at + 1 :] if groups else told
    # "turn on" goes nowhere
    particles = {tail for verb in verbs for one in verb.words for tail in one.split()[1:]}
    before, after = _parted([w for i, w in enumerate(rest) if not (i == 0 and w in particles)])
    objects, hints, keys = mentioned(before)
    if not objects and not _SEVERAL.isdisjoint(before):
        hints |= {ANYTHING}
    places, more_hints, more_keys = mentioned(after)
    phrase = Phrase(
        verbs=verbs,
        objects=objects,
        places=places,
        keys=keys | more_keys,
        hints=(hints | more_hints) - (VAGUE if useful else set()) | useful,
        words=tuple(words),
    )
    if objects or phrase.hints - VAGUE:
        return phrase
    unknown = frozenset() if spoken or ANYTHING in hints else frozenset((ANYTHING,))
    return replace(phrase, hints=phrase.hints | unknown, meant=spoken)


def _parted(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the words before the first destination and those after it, without where from."""
    table = names()
    before: list[str] = []
    after: list[str] = []
    into = before
    for at, word in enumerate(words):
        if word in table.destinations:
            into = after
        elif word == "from" or (word == "of" and at and words[at - 1] == "out"):
            into = []
        into.append(word)
    return before, after
