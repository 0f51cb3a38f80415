"""Questions to a recall: what is asked and remembered, what is right, how often it comes first.

A question tells of a few units: what was handled before it, or what is wanted and its rivals. The
others are drawn from the things of a room of that kind, so that a memory can be of any size; what
would be a right answer too is never drawn.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from karma.bench.figures.statistics import Estimate, mean
from karma.files import decode_json, read_bytes
from karma.household.pieces import EGG, base_type
from karma.household.places import HAND, ROOMS, SEVERAL
from karma.household.states import OPPOSITES, deed_for
from karma.household.types import object_types
from karma.household.uses import COOKED, TOASTED
from karma.plugins.training.drawing.memories import KnownRoom, Rng, pick, room_of, unit_of
from karma.seeds import stream
from karma.types.memory import MemoryUnit, Recalled
from karma.types.roles import Recall
from karma.world.core.scene import load

Marks = Literal["lived", "none", "against"]  # see `marked`
_PLANS = dict(zip((0, 2, 3, 4), ROOMS, strict=True))  # rooms by the hundreds of AI2-THOR's plans
_ROOMS_EACH = 4  # shipped ones of a kind
DRAWS = 3  # memories a question
STATES_BY_CAPABILITY = {
    "dirtyable": (("dirty", 0.15), ("cleaned", 0.3)),
    "canFillWithLiquid": (("filled", 0.15),),
    "openable": (("opened", 0.2), ("closed", 0.2)),
    "toggleable": (("on", 0.15), ("off", 0.15)),
    "canBeUsedUp": (("used up", 0.1),),
}  # capability -> (state, chance) of an object that was handled
FOOD_STATES = (("cleaned", 0.35), ("sliced", 0.35), ("heated", 0.08), ("cooked", 0.0))
SEEN_ONLY = 0.4  # factor of these chances for an object that was only seen
_SEEN_EACH = 5  # draws of the states and the place of each type of thing in a room


@dataclass(frozen=True, slots=True, kw_only=True)
class RecallQuestion:
    """One reference to something remembered."""

    name: str
    group: str  # questions of one group are not independent: of one task, or of one word
    kinds: tuple[str, ...]  # the classes that it counts in
    text: str  # the whole sub-task
    room: str  # kind of room
    told: tuple[MemoryUnit, ...]  # the last used last
    right: frozenset[str]  # ids of `told`, any of which answers
    skipped: frozenset[str] = frozenset()  # ids that the same sub-task needs for something else
    barred_types: frozenset[str] = frozenset()  # never drawn besides: they would be right too
    barred_states: frozenset[str] = frozenset()  # likewise


def memory_of(
    question: RecallQuestion, size: int, number: int, *, seed: int = 0
) -> tuple[MemoryUnit, ...]:
    """Return a memory in which the question can be answered, the last used last.

    What the question tells of is marked as it says, mostly as handled, all else as only seen.

    Args:
        question: what is asked.
        size: of the memory; no fewer than the question tells of.
        number: of the draw.
        seed: of the draws.
    """
    rng = stream(seed, "recall", question.name, str(size), str(number))
    barred = {base_type(kind) for kind in question.barred_types}
    barred |= {base_type(unit.object_type) for unit in question.told}
    pool = [
        unit
        for unit in _seen_things(question.room, seed)
        if base_type(unit.object_type) not in barred
        if not question.barred_states & set(unit.states)
    ]
    chosen = rng.integers(len(pool), size=max(size - len(question.told), 0))
    units = [replace(pool[at], object_id=f"seen{place}") for place, at in enumerate(chosen)]
    places = sorted(int(rng.integers(len(units) + 1)) for _ in question.told)
    for place, unit in reversed(list(zip(places, question.told, strict=True))):
        units.insert(place, unit)
    return tuple(units)


def marked(
    units: Sequence[MemoryUnit], question: RecallQuestion, marks: Marks
) -> tuple[MemoryUnit, ...]:
    """Return a memory of the question with other marks for what was handled.

    Args:
        units: as they were drawn.
        question: what is asked.
        marks: "lived": as they are; "none": nothing was handled; "against": what is right was only
            seen, and of the rest every other one handled.
    """
    if marks == "lived":
        return tuple(units)
    return tuple(
        replace(
            unit,
            handled=marks == "against" and at % 2 == 0 and unit.object_id not in question.right,
        )
        for at, unit in enumerate(units)
    )


@cache
def _seen_things(room: str, seed: int) -> Sequence[MemoryUnit]:
    """Return things of rooms of a kind as they may lie there, to fill memories with."""
    rng = stream(seed, "recall", room)
    return [
        _seen(rng, one, kind)
        for one in rooms_of(room)
        for kind in one.movables
        for _ in range(_SEEN_EACH)
    ]


def _seen(rng: Rng, room: KnownRoom, kind: str) -> MemoryUnit:
    """Sample the states and the place of an object that was seen and not handled."""
    info = object_types()[kind]
    odds = FOOD_STATES if info.slices_into or kind == EGG else ()
    for capability, more in STATES_BY_CAPABILITY.items():
        if capability in info.capabilities:
            odds = (*odds, *more)
    states: list[str] = []
    for state, chance in odds:
        chance = 0.2 if state == "cooked" and kind in (*COOKED, TOASTED) else chance
        if rng.random() < chance * SEEN_ONLY and OPPOSITES.get(state) not in states:
            states.append(state)
    if "sliced" in states and not info.slices_into:
        states.remove("sliced")
    rng.shuffle(states)
    sliced = info.slices_into if "sliced" in states and info.slices_into else kind
    fits = [name for name in room.landmarks if object_types()[sliced].fits(object_types()[name])]
    place = None
    if fits and rng.random() >= 0.04:
        name = pick(rng, fits)
        place = f"{name}|{int(rng.integers(1, 4)) if name in SEVERAL else 1}"
    return unit_of(f"{kind}|0", sliced, states=tuple(states), place_id=place)


@cache
def rooms_of(kind: str) -> Sequence[KnownRoom]:
    """Return the shipped rooms of a kind."""
    names = [f"{kind}_{number}" for number in range(1, _ROOMS_EACH + 1)]
    return [room_of(load(name), name, keep=1.0) for name in names]


# ----------------------------------------------------------------- how often a right unit is first


class InOrder:
    """A control row: units by an order that does not read the question.

    Args:
        by: "chance" shuffles them, "recency" has the last handled first, "handled" has what was
            handled first, in any order.
        seed: of the shuffles.
    """

    def __init__(self, by: str, *, seed: int = 0) -> None:
        self._by, self._seed = by, seed

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the first k of that order, all with similarity 0."""
        found = list(units)
        if self._by == "recency":
            found.reverse()
        else:
            ids = "/".join(unit.object_id for unit in units)
            stream(self._seed, "recall", self._by, query, ids).shuffle(found)
        if self._by != "chance":
            found.sort(key=lambda unit: not unit.handled)
        return [Recalled(unit=unit, similarity=0.0) for unit in found[:k]]


CONTROLS = ("chance", "recency", "handled")


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """One row of the table: R@1 by class."""

    row: str
    units: int
    marks: Marks
    by_kind: Mapping[str, Estimate]


def ask(
    rows: Mapping[tuple[str, Marks], Recall],
    questions: Iterable[RecallQuestion],
    units: int,
    *,
    draws: int = DRAWS,
) -> list[Asked]:
    """Ask every question over several memories, the same ones for all rows.

    Args:
        rows: (what it is called in the table, who is marked as handled) -> what is measured.
        questions: of all classes.
        units: size of the memories.
        draws: memories a question.
    """
    hits: dict[tuple[str, Marks], dict[str, dict[str, list[float]]]] = {row: {} for row in rows}
    for question in questions:
        for number in range(draws):
            memory = memory_of(question, units, number)
            for row, recall in rows.items():
                right = is_right(recall, question, marked(memory, question, row[1]))
                for kind in question.kinds:
                    of_kind = hits[row].setdefault(kind, {})
                    of_kind.setdefault(question.group, []).append(float(right))
    return [
        Asked(
            row=name,
            units=units,
            marks=marks,
            by_kind={kind: mean(list(groups.values())) for kind, groups in by_kind.items()},
        )
        for (name, marks), by_kind in hits.items()
    ]


def is_right(recall: Recall, question: RecallQuestion, units: Sequence[MemoryUnit]) -> bool:
    """Return whether the first unit, those skipped left out, is a right one."""
    found = recall.recall(question.text, units, len(question.skipped) + 1)
    first = next(one.unit.object_id for one in found if one.unit.object_id not in question.skipped)
    return first in question.right


# ----------------------------------------------------------------- files


def read_questions(path: Path) -> list[RecallQuestion]:
    """Return the questions of a file of ours, one of JSON a line.

    Raises:
        FileError: it is missing, or a line does not fit.
    """
    return [decode_json(line, RecallQuestion, path=path) for line in read_bytes(path).splitlines()]


class _Thing(msgspec.Struct, frozen=True, kw_only=True):
    type: str
    state: str
    key: str = ""
    loc: str = ""


class _Alfred(msgspec.Struct, frozen=True, kw_only=True):
    id: str
    task: str
    cls: str
    kind: str
    floorplan: int
    query: str
    ref: str
    gold: tuple[str, ...]
    alt: tuple[str, ...]
    also: tuple[str, ...]
    exclude: tuple[str, ...]
    memory: tuple[_Thing, ...]


def read_alfred_l(path: Path, *, phrases: bool = False) -> list[RecallQuestion]:
    """Return the reference questions about the authors' tasks; errors as in `read_questions`.

    Args:
        path: of the questions.
        phrases: ask with the phrase that names the thing alone, not with the whole sub-task.
    """
    rows = [decode_json(line, _Alfred, path=path) for line in read_bytes(path).splitlines()]
    found = map(_of_task, rows)
    return [replace(q, text=raw.ref) if phrases else q for q, raw in zip(found, rows, strict=True)]


def _of_task(raw: _Alfred) -> RecallQuestion:
    return RecallQuestion(
        name=raw.id,
        group=raw.task,
        kinds=(raw.cls, f"{raw.cls} {raw.kind}") if raw.cls == "complex" else (raw.cls,),
        text=raw.query,
        room=_PLANS[raw.floorplan // 100],
        told=tuple(_unit(one, one.key) for one in raw.memory),
        right=frozenset((*raw.gold, *raw.alt)),
        skipped=frozenset(raw.also),
        barred_types=frozenset(raw.exclude),
    )


class _Household(msgspec.Struct, frozen=True, kw_only=True):
    id: str
    kind: str
    query: str
    room: str
    gold: tuple[_Thing, ...]
    rivals: tuple[_Thing, ...]
    exclude: tuple[str, ...]
    exclude_states: tuple[str, ...] = ()


def read_household(path: Path) -> list[RecallQuestion]:
    """Return the reference questions about a household; errors as in `read_questions`."""
    lines = read_bytes(path).splitlines()
    return [_of_household(decode_json(line, _Household, path=path)) for line in lines]


def _of_household(raw: _Household) -> RecallQuestion:
    right = [_unit(one, f"right{at}") for at, one in enumerate(raw.gold)]
    rivals = [_unit(one, f"rival{at}") for at, one in enumerate(raw.rivals)]
    told = [*right, *rivals]
    stream(0, "recall", raw.id).shuffle(told)
    return RecallQuestion(
        name=raw.id,
        group=raw.id,
        kinds=(raw.kind.replace("_", " + "),),
        text=raw.query,
        room=next(kind for kind in ROOMS if kind.startswith(raw.room)),
        told=tuple(told),
        right=frozenset(unit.object_id for unit in right),
        barred_types=frozenset(raw.exclude),
        barred_states=frozenset(filter(None, map(deed_for, raw.exclude_states))),
    )


def _unit(raw: _Thing, name: str) -> MemoryUnit:
    state = deed_for(raw.state)
    place = raw.loc if raw.loc in ("", HAND) else f"{raw.loc}|1"
    return MemoryUnit(
        object_id=name,
        object_type=raw.type,
        position_m=(0.0, 0.0, 0.0),
        states=(state,) if state else (),
        place_id=place or None,
        handled=True,
    )
