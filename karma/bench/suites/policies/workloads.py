"""ALFWorld-R: seeded random sequences of tasks, as access traces.

The paper draws "each task randomly from tasks in ALFRED"; that is `type`. The others keep to one
house (a kitchen, a living room, a bedroom, a bathroom) and come closer to how homes are used:

| workload | next task | a unit is |
|---|---|---|
| `type` | any task there is | an object type |
| `house` | any task of the house | a type in its room |
| `rooms` | of the room; after 8 tasks on average (geometric), another room | same |
| `habit` | of the room that the hour wants (12 a day, each room at least once), Zipf(1) over the household's own order of its tasks, a fifth of which is dealt anew every 20 days | same |
| `chain` | half of the time one about a thing of the last 3 tasks, else any of the house | same |
"""  # noqa: E501

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Literal, get_args

import numpy as np

from karma.bench.suites.policies.simulate import Trace
from karma.bench.suites.policies.tasks import Errand, Pool, UnitSet
from karma.errors import KarmaError
from karma.household.places import ROOMS
from karma.seeds import stream

Workload = Literal["type", "house", "rooms", "habit", "chain"]
WORKLOADS: tuple[Workload, ...] = get_args(Workload)

STAY = 8  # tasks in a room, on average
DAY = 12  # tasks a day, each in the room of its hour
DAYS = 20  # until some habits change
CHANGED = 0.2  # of the ranks then
CHAINED = 0.5  # chance that a task is about a thing of the last ones
LAST = 3  # of them

Rng = np.random.Generator
Draws = Iterator[Errand]
House = dict[str, tuple[Errand, ...]]  # room -> its tasks


def draw_errands(
    pool: Pool, workload: Workload, length: int, seed: int, number: int
) -> list[Errand]:
    """Draw one sequence of tasks.

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
    """Return what a sequence of tasks asks for."""
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


def _one_of(rng: Rng, errands: Sequence[Errand]) -> Errand:
    return errands[int(rng.integers(len(errands)))]


def _uniform(rng: Rng, errands: Sequence[Errand]) -> Draws:
    while True:
        yield _one_of(rng, errands)


def _any_of_house(rng: Rng, house: House) -> Draws:
    return _uniform(rng, _all(house))


def _in_phases(rng: Rng, house: House) -> Draws:
    room = ROOMS[int(rng.integers(len(ROOMS)))]
    while True:
        tasks = house[room]
        for _ in range(int(rng.geometric(1 / STAY))):
            yield _one_of(rng, tasks)
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
            before = _one_of(rng, last)
            name = before.subjects[int(rng.integers(len(before.subjects)))]
            choices: Sequence[Errand] = about[before.scene, name]
        else:
            choices = every
        last = [*last, _one_of(rng, choices)][-LAST:]
        yield last[-1]


_DRAWS: dict[str, Callable[[Rng, House], Draws]] = {
    "house": _any_of_house,
    "rooms": _in_phases,
    "habit": _by_habit,
    "chain": _in_chains,
}
