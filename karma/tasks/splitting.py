"""An instruction string to clauses, and each goal to the clause in which it becomes due.

`loose_names.toml` holds what words mean.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec

from karma.contracts import Goal, SubTask
from karma.files import read_toml
from karma.household.pieces import base_type
from karma.household.states import canonical_state
from karma.household.types import object_type, object_types
from karma.tasks.goals import object_names

NAMES = Path(__file__).parent / "loose_names.toml"
BEAM = 200  # assignments of goals to clauses kept at a time
FITS = 2  # the least score at which a goal belongs to a clause at all


class _Verbs(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    words: tuple[str, ...]
    states: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    predicates: tuple[str, ...] = ()


class _Names(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    lead_ins: tuple[str, ...]
    destinations: tuple[str, ...]
    types: dict[str, tuple[tuple[str, ...], ...]]
    vague: dict[str, tuple[str, ...]]
    verbs: dict[str, _Verbs]


# ----------------------------------------------------------------- clauses


@dataclass(frozen=True, slots=True, kw_only=True)
class _Clause:
    """What one clause speaks of, in AI2-THOR types."""

    text: str
    verbs: frozenset[str]  # groups of loose_names.toml
    objects: frozenset[str]  # named before the first destination word
    places: frozenset[str]  # named after it
    vague: frozenset[str]


def split_instruction(text: str) -> tuple[str, ...]:
    """Return the clauses of an instruction: each begins with a verb, save perhaps the first."""
    parts = re.split(r"[.;!?](?:\s|$)|,|→|->|\b[Tt]hen\b", text)
    clauses: list[str] = []
    waiting = ""
    for part in parts:
        part = re.sub(r"^(?:and\s+)+|\s+and$", "", " ".join(part.split())).strip()
        if not part or part.lower() in ("and", "after that", "please"):
            continue
        if _verb_at(words_of(part), 0):
            clauses.append(f"{waiting}{part}")
            waiting = ""
        elif clauses:
            clauses[-1] += f", {part}"
        else:
            waiting += f"{part}, "
    return tuple(clauses) or (text.strip(),)


def assign(goals: Sequence[Goal], clauses: Sequence[str]) -> tuple[SubTask, ...]:
    """Return one sub-task per clause, each goal in the clause where it becomes due.

    Goals that exclude each other (a second place for the same object) go to different clauses, for
    which a clause may be cut at "and <verb>". A goal that fits no clause goes to the last one.
    """
    chosen = _best_assignment(goals, [_read_clause(text) for text in clauses])
    for number, text in enumerate(clauses):
        due = [goal for goal, clause in zip(goals, chosen, strict=True) if clause == number]
        halves = _halves(text) if _excluding(due) else ()
        if halves:
            return assign(goals, (*clauses[:number], *halves, *clauses[number + 1 :]))
    return tuple(
        SubTask(
            instruction=text,
            goals=tuple(dict.fromkeys(g for g, c in zip(goals, chosen, strict=True) if c == i)),
        )
        for i, text in enumerate(clauses)
    )


def _best_assignment(goals: Sequence[Goal], clauses: Sequence[_Clause]) -> tuple[int, ...]:
    """Search, by beam, for the clause numbers with the best sum of fits.

    Stepping back in the order of clauses costs 2; two goals that exclude each other must follow
    each other, else it costs 20.
    """
    beam: list[tuple[int, tuple[int, ...]]] = [(0, ())]
    for number, goal in enumerate(goals):
        fits = {i: _fit(goal, clause) for i, clause in enumerate(clauses)}
        if max(fits.values()) < FITS:
            fits = {len(clauses) - 1: 0}
        before = [i for i in range(number) if exclude(goals[i], goal)]
        grown = []
        for score, chosen in beam:
            for clause, fit in fits.items():
                back = 2 if chosen and clause < chosen[-1] else 0
                torn = 20 * sum(chosen[i] >= clause for i in before)
                grown.append((score + fit - back - torn, (*chosen, clause)))
        beam = sorted(grown, key=lambda entry: (-entry[0], entry[1]))[:BEAM]
    return beam[0][1]


def _fit(goal: Goal, clause: _Clause) -> int:
    """Return how well a goal suits a clause: by its object, then by its place or the verb."""
    subject = meaning(object_names(goal)[0])
    verbs = [_names().verbs[group] for group in clause.verbs]
    done_at = {place for verb in verbs for place in verb.places}
    named = subject & (clause.objects | clause.places)
    hinted = subject & clause.vague or "*" in clause.vague
    score = 2 if named else 1 if hinted else 0
    if goal.predicate in ("ON", "INSIDE"):
        return score + _fit_place(goal, clause, done_at, other=score == 0)
    if goal.predicate == "STATE":
        wanted = canonical_state(goal.arguments[1])
        return score + 3 * any(wanted in verb.states for verb in verbs)
    if subject & done_at:
        return score + 3
    return score + 2 * (score > 0 and any(goal.predicate in verb.predicates for verb in verbs))


def _fit_place(goal: Goal, clause: _Clause, done_at: set[str], *, other: bool) -> int:
    """Return how well a placement suits a clause, its object left aside.

    Args:
        goal: ON or INSIDE.
        clause: what it is held against.
        done_at: the places that go with the clause's verbs.
        other: the clause does not speak of the goal's object.
    """
    place = meaning(goal.arguments[1])
    score = int("place" in clause.verbs) + (place & done_at != frozenset())
    if other and clause.objects:
        score -= 2
    if place & (clause.places | done_at):
        return score + 3
    elsewhere = any(object_type(kind).can("receptacle") for kind in clause.places)
    return score - 2 if place and elsewhere else score


def exclude(one: Goal, other: Goal) -> bool:
    """Return whether two goals cannot both become due at once: same object, other outcome."""
    if object_names(one)[0].lower() != object_names(other)[0].lower():
        return False
    placing = ("ON", "INSIDE", "HOLDON")
    if one == other:
        return True
    if one.predicate in placing and other.predicate in placing:
        return one.arguments[-1].lower() != other.arguments[-1].lower()
    return {one.predicate, other.predicate} in ({"TOGGLEON", "TOGGLEOFF"}, {"OPEN", "CLOSED"})


def _excluding(goals: Sequence[Goal]) -> bool:
    return any(exclude(a, b) and a != b for i, a in enumerate(goals) for b in goals[:i])


def _halves(text: str) -> tuple[str, ...]:
    """Return a clause cut at its first "and <verb>"; () where there is none."""
    for match in re.finditer(r"\s+and\s+", text):
        if _verb_at(words_of(text[match.end() :]), 0):
            return text[: match.start()], text[match.end() :]
    return ()


# ----------------------------------------------------------------- words


@cache
def _names() -> _Names:
    """Return the table of names; keys without spaces, singular."""
    table = read_toml(NAMES, _Names)
    types: dict[str, tuple[tuple[str, ...], ...]] = {
        key_of(name): ((name,),) for name in object_types()
    }
    types |= {key_of(name): tiers for name, tiers in table.types.items()}
    for kind in {kind for tiers in types.values() for tier in tiers for kind in tier}:
        object_type(kind)
    vague = {key_of(name): kinds for name, kinds in table.vague.items()}
    return msgspec.structs.replace(table, types=types, vague=vague)


def tiers_of(name: str) -> tuple[tuple[str, ...], ...]:
    """Return the types that a loose name may stand for, in tiers of preference; () if unknown."""
    return _names().types.get(key_of(name), ())


def words_of(text: str) -> list[str]:
    """Return the words of a text, lower-case, without possessive endings."""
    return re.findall(r"[a-z0-9]+", text.lower().replace("'s", ""))


def key_of(name: str) -> str:
    """Return the singular of a name without spaces or case, under which tables keep it."""
    return "".join(_singular(word) for word in words_of(name))


def _singular(word: str) -> str:
    for ending, instead in (
        ("ives", "ife"), ("ves", "f"), ("oes", "o"), ("ches", "ch"), ("shes", "sh"), ("xes", "x"),
        ("sses", "ss"), ("ss", "ss"), ("us", "us"), ("s", ""),
    ):  # fmt: skip
        if word.endswith(ending) and len(word) > len(ending) + 1:
            return word.removesuffix(ending) + instead
    return word


def meaning(name: str) -> frozenset[str]:
    """Return every type that a loose name may stand for, wholes for slices as well."""
    kinds = {kind for tier in _names().types.get(key_of(name), ()) for kind in tier}
    return frozenset(kinds | set(map(base_type, kinds)))


def _verb_at(words: Sequence[str], start: int) -> frozenset[str]:
    """Return the groups of the verb that stands at `start`, lead-ins aside; empty if none does."""
    names = _names()
    while start < len(words) and words[start] in names.lead_ins:
        start += 1
    if start == len(words):
        return frozenset()
    found = set()
    for group, verbs in names.verbs.items():
        for verb in verbs.words:
            head, *tail = verb.split()
            if head == words[start] and all(word in words[start:] for word in tail):
                found.add(group)
    return frozenset(found)


def _read_clause(text: str) -> _Clause:
    words = words_of(text)
    joints = [i + 1 for i, word in enumerate(words) if word == "and"]
    verbs = frozenset(group for start in [0, *joints] for group in _verb_at(words, start))
    names = _names()
    spoken = {
        word for verb in names.verbs.values() for word in verb.words
    }  # "turn on" goes nowhere
    first = 0
    while first < len(words) and (
        words[first] not in names.destinations
        or " ".join(words[max(first - 1, 0) : first + 1]) in spoken
    ):
        first += 1
    objects, hints = _mentioned(words[:first])
    places, more_hints = _mentioned(words[first:])
    return _Clause(text=text, verbs=verbs, objects=objects, places=places, vague=hints | more_hints)


def _mentioned(words: Sequence[str]) -> tuple[frozenset[str], frozenset[str]]:
    """Return the types that are named and those only hinted at; longer names win."""
    named: set[str] = set()
    hinted: set[str] = set()
    start = 0
    while start < len(words):
        for length in (3, 2, 1):
            key = key_of(" ".join(words[start : start + length]))
            if key in _names().types:
                named |= meaning(key)
                break
            if key in _names().vague:
                hinted |= set(_names().vague[key])
                break
        start += length
    return frozenset(named), frozenset(hinted)
