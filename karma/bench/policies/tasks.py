"""Tasks as the units they need, and sequences of tasks as access traces.

A task is written down as two lists of object types, in the order of its plan:

- R4: the object, the movable receptacle, the thing to switch on, and the receptacle.
- M: what can be carried only: the object, the movable receptacle, and the knife if one is used.

Slices count as what they were cut from.

ALFWorld-R is seeded random sequences of tasks. The paper draws "each task randomly from tasks in
ALFRED"; that is `type`. The others keep to one house (a kitchen, a living room, a bedroom, a
bathroom) and come closer to how homes are used:

| workload | next task | a unit is |
|---|---|---|
| `type` | any task there is | an object type |
| `house` | any task of the house | a type in its room |
| `rooms` | of the room; after 8 tasks on average (geometric), another room | same |
| `habit` | of the room that the hour wants (12 a day, each room at least once), Zipf(1) over the household's own order of its tasks, a fifth of which is dealt anew every 20 days | same |
| `chain` | half of the time one about a thing of the last 3 tasks, else any of the house | same |

A plug-in registers a reader of task files under `karma.task_pools`; without files the tasks
are about our own rooms.
"""  # noqa: E501

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import islice, product
from typing import Literal, TypeVar, get_args

import numpy as np

from karma.bench.policies.simulate import Trace
from karma.errors import KarmaError
from karma.household.containment import goes_in
from karma.household.pieces import base_type
from karma.household.places import FLOOR, ROOMS
from karma.household.types import types_with
from karma.household.uses import KNIVES
from karma.seeds import stream
from karma.world.core.scene import load

UnitSet = Literal["r4", "m"]
UNIT_SETS: tuple[UnitSet, ...] = get_args(UnitSet)
SMOOTHING = 0.5  # added to each count of where things were found
GRAMMAR_SCENES = 4  # of our rooms, of each kind
GRAMMAR_TASKS = 40  # requests drawn in each
T = TypeVar("T")
Rng = np.random.Generator


@dataclass(frozen=True, slots=True, kw_only=True)
class Errand:
    """A task as the units it needs."""

    scene: str  # where
    room: str  # its kind, one of `ROOMS`
    r4: tuple[str, ...]  # types of all units
    m: tuple[str, ...]  # types of those that can be carried, and of the knife
    subjects: tuple[str, ...]  # the object and the movable receptacle

    def units(self, unit_set: UnitSet) -> tuple[str, ...]:
        """Return the types of one of the two sets."""
        return self.r4 if unit_set == "r4" else self.m


@dataclass(frozen=True, kw_only=True)
class Finds:
    """Receptacles of scenes, and counts of objects found in them."""

    places: Mapping[str, Mapping[str, int]]  # scene -> receptacle type -> how many of it there are
    found: Mapping[tuple[str, str], Mapping[str, int]]  # (room, type) -> receptacle type -> times

    def stops(self, scene: str, room: str, object_type: str) -> float | None:
        """Return how many receptacles a search for an object is expected to visit.

        The receptacles of the scene are visited type by type, the likeliest type first, as often
        as the type was found to hold such an object in rooms of the kind (+ 0.5). None where the
        scene has no receptacle.
        """
        here = self.places.get(scene, {})
        found = self.found.get((room, object_type), {})
        weights = {kind: found.get(kind, 0) + SMOOTHING for kind in here}
        total, before, stops = sum(weights.values()), 0, 0.0
        for kind in sorted(weights, key=lambda kind: (-weights[kind], kind)):
            stops += weights[kind] / total * (before + (here[kind] + 1) / 2)
            before += here[kind]
        return stops if here else None


@dataclass(frozen=True, kw_only=True)
class Pool:
    """Tasks to draw from."""

    source: str  # where they come from, for captions
    errands: tuple[Errand, ...]  # all of them, in order
    finds: Finds  # what tells the cost of a search
    _costs: dict[tuple[str, str], float] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def homes(self) -> Mapping[str, Mapping[str, tuple[Errand, ...]]]:
        """Room kind -> scene -> its tasks; sorted by name."""
        found: dict[str, dict[str, list[Errand]]] = {room: {} for room in ROOMS}
        for errand in self.errands:
            found[errand.room].setdefault(errand.scene, []).append(errand)
        return {
            room: {scene: tuple(scenes[scene]) for scene in sorted(scenes)}
            for room, scenes in found.items()
        }

    def cost(self, errand: Errand, object_type: str) -> float:
        """Return the stops of a search for a unit of a task; what cannot be carried costs one."""
        key = (errand.scene, object_type)
        if key not in self._costs:
            stops = None
            if object_type in types_with("pickupable"):
                stops = self.finds.stops(errand.scene, errand.room, object_type)
            self._costs[key] = 1.0 if stops is None else stops
        return self._costs[key]


# ------------------------------------------------------------- tasks of our own


def distinct(names: Iterable[str]) -> tuple[str, ...]:
    """Return the base types of names, each once; empty names are left out."""
    return tuple(dict.fromkeys(base_type(name) for name in names if name))


@lru_cache(maxsize=4)
def grammar_pool(seed: int, *, scenes: int = GRAMMAR_SCENES, tasks: int = GRAMMAR_TASKS) -> Pool:
    """Return tasks about movable objects of the rooms that ship."""
    errands: list[Errand] = []
    places: dict[str, Counter[str]] = {}
    found: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    movable = types_with("pickupable")
    for room, number in product(ROOMS, range(1, scenes + 1)):
        name = f"{room}_{number}"
        scene = load(name)
        types = {item.id: item.type for item in scene.objects}
        fixed = [one for one in scene.objects if one.type not in movable]
        places[name] = Counter(one.type for one in fixed if "receptacle" in one.capabilities)
        for item in scene.objects:
            if item.type in movable and item.parents and types[item.parents[0]] not in movable:
                found[room, item.type][types[item.parents[0]]] += 1
        rng = stream(seed, "lab", "grammar", name)
        here = tuple(sorted(set(types.values())))
        errands += (_errand(rng, name, room, here) for _ in range(tasks))
    finds = Finds(places=places, found=found)
    return Pool(source=f"our task grammar, seed {seed}", errands=tuple(errands), finds=finds)


def _errand(rng: Rng, scene: str, room: str, here: Sequence[str]) -> Errand:
    """Sample a task: move an object, a third of the time in a vessel, cut, or under a lamp."""
    movable, lit = types_with("pickupable"), types_with("toggleable")
    subject = _pick(rng, [one for one in here if one in movable])
    ends = [one for one in here if one not in (*movable, FLOOR) and goes_in(subject, one)]
    end = _pick(rng, ends) if ends else ""
    vessel, knife, lamp = "", "", ""
    draw = rng.random()
    if draw < 1 / 9:
        vessels = [one for one in here if one in movable and goes_in(subject, one)]
        vessel = _pick(rng, vessels) if vessels else ""
    elif draw < 2 / 9 and subject in types_with("sliceable"):
        knife = next((one for one in KNIVES if one in here), "")
    elif draw < 3 / 9:
        lamps = [one for one in here if one in lit and one.endswith("Lamp")]
        lamp, end = (_pick(rng, lamps), "") if lamps else ("", end)
    return Errand(
        scene=scene,
        room=room,
        r4=distinct((subject, vessel, lamp, end)),
        m=distinct((subject, vessel, knife)),
        subjects=distinct((subject, vessel)),
    )


# ------------------------------------------------------------- sequences of tasks, as traces

Workload = Literal["type", "house", "rooms", "habit", "chain"]
WORKLOADS: tuple[Workload, ...] = get_args(Workload)

STAY = 8  # tasks in a room, on average
DAY = 12  # tasks a day, each in the room of its hour
DAYS = 20  # until some habits change
CHANGED = 0.2  # of the ranks then
CHAINED = 0.5  # chance that a task is about a thing of the last ones
LAST = 3  # of them

Draws = Iterator[Errand]
House = dict[str, tuple[Errand, ...]]  # room -> its tasks


def draw_errands(
    pool: Pool, workload: Workload, length: int, seed: int, number: int
) -> list[Errand]:
    """Sample a sequence of tasks.

    A shorter sequence is the beginning of a longer one. KarmaError if the pool has no task in
    some kind of room.
    """
    rng = stream(seed, "lab", workload, str(number))
    draw = (
        _uniform(rng, pool.errands)
        if workload == "type"
        else _DRAWS[workload](rng, _house(rng, pool))
    )
    return list(islice(draw, length))


def trace_of(errands: Sequence[Errand], workload: Workload, unit_set: UnitSet) -> Trace:
    """Return the access trace of a sequence of tasks."""
    if workload == "type":
        return Trace.of(errand.units(unit_set) for errand in errands)
    return Trace.of(
        [f"{errand.scene}/{name}" for name in errand.units(unit_set)] for errand in errands
    )


def costs_of(errands: Sequence[Errand], unit_set: UnitSet, pool: Pool) -> list[float]:
    """Return for each request the stops of the search that a hit saves."""
    return [pool.cost(errand, name) for errand in errands for name in errand.units(unit_set)]


def _house(rng: Rng, pool: Pool) -> House:
    house = {}
    for room in ROOMS:
        scenes = pool.homes[room]
        if not scenes:
            raise KarmaError(f"{pool.source}: no tasks in a {room}, and a house needs one")
        house[room] = tuple(scenes.values())[int(rng.integers(len(scenes)))]
    return house


def _all(house: House) -> tuple[Errand, ...]:
    return tuple(errand for room in ROOMS for errand in house[room])


def _pick(rng: Rng, items: Sequence[T]) -> T:
    return items[int(rng.integers(len(items)))]


def _uniform(rng: Rng, errands: Sequence[Errand]) -> Draws:
    while True:
        yield _pick(rng, errands)


def _in_phases(rng: Rng, house: House) -> Draws:
    room = ROOMS[int(rng.integers(len(ROOMS)))]
    while True:
        tasks = house[room]
        for _ in range(int(rng.geometric(1 / STAY))):
            yield _pick(rng, tasks)
        others = [other for other in ROOMS if other != room]
        room = others[int(rng.integers(len(others)))]


def _by_habit(rng: Rng, house: House) -> Draws:
    more = [ROOMS[int(rng.integers(len(ROOMS)))] for _ in range(DAY - len(ROOMS))]
    hours = [(*ROOMS, *more)[int(place)] for place in rng.permutation(DAY)]
    ranks = {room: rng.permutation(len(house[room])) for room in ROOMS}
    odds = {room: np.cumsum(1 / np.arange(1, len(house[room]) + 1)) for room in ROOMS}

    def usual(room: str) -> Errand:
        rank = int(np.searchsorted(odds[room], rng.random() * odds[room][-1], "right"))
        return house[room][int(ranks[room][rank])]

    while True:
        for _ in range(DAYS):
            for room in hours:
                yield usual(room)
        for room in ROOMS:
            order = ranks[room]
            moved = rng.choice(len(order), size=round(CHANGED * len(order)), replace=False)
            order[moved] = order[rng.permutation(moved)]


def _in_chains(rng: Rng, house: House) -> Draws:
    every = _all(house)
    about: dict[tuple[str, str], list[Errand]] = defaultdict(list)
    for errand in every:
        for name in errand.subjects:
            about[errand.scene, name].append(errand)
    last: list[Errand] = []
    while True:
        if last and rng.random() < CHAINED:
            before = _pick(rng, last)
            name = before.subjects[int(rng.integers(len(before.subjects)))]
            choices: Sequence[Errand] = about[before.scene, name]
        else:
            choices = every
        last = [*last, _pick(rng, choices)][-LAST:]
        yield last[-1]


_DRAWS: dict[str, Callable[[Rng, House], Draws]] = {
    "house": lambda rng, house: _uniform(rng, _all(house)),
    "rooms": _in_phases,
    "habit": _by_habit,
    "chain": _in_chains,
}
