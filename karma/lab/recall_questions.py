"""Questions to a recall: what is asked, what is remembered, which units are right.

A question tells of a few units: what was handled before it, or what is wanted and its rivals. The
others are drawn from the things of a room of that kind, so that a memory can be of any size; what
would be a right answer too is never drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from karma.contracts import MemoryUnit
from karma.files import decode_json, read_bytes
from karma.household.pieces import base_type
from karma.household.places import HAND, ROOMS
from karma.household.states import deed_for
from karma.seeds import stream
from karma.tasks.drawing.memories import KnownRoom, draw_unit
from karma.tasks.drawing.rooms import room_of
from karma.world.core.scene import load

Marks = Literal["lived", "none", "against"]  # see `memory_of`
_PLANS = dict(zip((0, 2, 3, 4), ROOMS, strict=True))  # rooms by the hundreds of AI2-THOR's plans
_ROOMS_EACH = 4  # shipped ones of a kind


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
    question: RecallQuestion, size: int, number: int, *, marks: Marks = "lived", seed: int = 0
) -> tuple[MemoryUnit, ...]:
    """Return a memory in which the question can be answered, the last used last.

    Args:
        question: what is asked.
        size: of the memory; no fewer than the question tells of.
        number: of the draw.
        marks: "lived": what the question tells of was handled, all else only seen; "none": nothing
            is marked as handled; "against": what is right was only seen, half of the rest handled.
        seed: of the draws.
    """
    rng = stream(seed, "recall", question.name, str(size), str(number))
    rooms = _rooms()[question.room]
    room = rooms[int(rng.integers(len(rooms)))]
    barred = {base_type(kind) for kind in question.barred_types}
    barred |= {base_type(unit.object_type) for unit in question.told}
    pool = [kind for one in rooms for kind in one.movables if base_type(kind) not in barred]
    units: list[MemoryUnit] = []
    while len(units) + len(question.told) < size:
        kind = pool[int(rng.integers(len(pool)))]
        unit = draw_unit(rng, room, kind, len(units), units, handled=False)
        if not question.barred_states & set(unit.states):
            units.append(unit)
    places = sorted(int(rng.integers(len(units) + 1)) for _ in question.told)
    for place, unit in reversed(list(zip(places, question.told, strict=True))):
        units.insert(place, unit)
    coins = rng.random(len(units))
    return tuple(_marked(unit, question, marks, coins[at]) for at, unit in enumerate(units))


def _marked(unit: MemoryUnit, question: RecallQuestion, marks: Marks, coin: float) -> MemoryUnit:
    if marks == "lived":
        return unit
    handled = marks == "against" and unit.object_id not in question.right and coin < 0.5
    return replace(unit, handled=handled)


@cache
def _rooms() -> Mapping[str, Sequence[KnownRoom]]:
    names = {kind: [f"{kind}_{n}" for n in range(1, _ROOMS_EACH + 1)] for kind in ROOMS}
    return {
        kind: [room_of(load(name), name, keep=1.0) for name in of_kind]
        for kind, of_kind in names.items()
    }


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
    gold: tuple[str, ...]
    alt: tuple[str, ...]
    also: tuple[str, ...]
    exclude: tuple[str, ...]
    memory: tuple[_Thing, ...]


def read_alfred_l(path: Path) -> list[RecallQuestion]:
    """Return the reference questions about the authors' tasks; errors as in `read_questions`."""
    return [
        _of_task(decode_json(line, _Alfred, path=path)) for line in read_bytes(path).splitlines()
    ]


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
