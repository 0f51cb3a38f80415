"""What tasks need, ALFRED's own or those of our grammar, and what the search for it costs.

A task is written down as two lists of object types, in the order of its plan:

- R4: the object, the movable receptacle, the thing to switch on, and the receptacle.
- M: what can be carried only: the object, the movable receptacle, and the knife if one is used.

Slices count as what they were cut from.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import msgspec

from karma.agent.loading.alfred_sentences import read_demonstrations
from karma.errors import FileError, KarmaError
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.places import ROOMS
from karma.household.types import types_with
from karma.household.uses import KNIVES
from karma.seeds import stream
from karma.world.alfred.trial import PlannerAction, Targets

if TYPE_CHECKING:
    from karma.bench.drawing.memories import KnownRoom
    from karma.bench.drawing.phrases import Book

UnitSet = Literal["r4", "m"]
UNIT_SETS: tuple[UnitSet, ...] = get_args(UnitSet)
SMOOTHING = 0.5  # added to each count of where things were found
GRAMMAR_SCENES = 10  # generated rooms of each kind
GRAMMAR_TASKS = 40  # requests drawn in each
_FLOOR_PLANS = dict(zip((0, 2, 3, 4), ROOMS, strict=True))  # by the hundred


@dataclass(frozen=True, slots=True, kw_only=True)
class Errand:
    """One task as the units it needs."""

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
    """Where things were found, and where one can look."""

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


# ------------------------------------------------------------- ALFRED's tasks


class _Scene(msgspec.Struct, frozen=True):
    floor_plan: str


class _PlanStep(msgspec.Struct, frozen=True):
    planner_action: PlannerAction


class _Plan(msgspec.Struct, frozen=True):
    high_pddl: tuple[_PlanStep, ...]


class _Trial(msgspec.Struct, frozen=True):
    pddl_params: Targets
    scene: _Scene
    plan: _Plan


def alfred_pool(paths: Iterable[Path]) -> Pool:
    """Return the tasks of files of ALFRED demonstrations, one JSON record a line.

    FileError if a file is missing, torn, or holds something else.
    """
    paths = tuple(paths)
    movable = types_with("pickupable")
    errands: list[Errand] = []
    spots: dict[str, set[tuple[str, str]]] = defaultdict(set)
    found: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for path in paths:
        for trial in read_demonstrations(path, _Trial):
            errand = _errand(trial, path)
            errands.append(errand)
            picked: set[str] = set()
            for kind, receptacle, spot in _handled(trial):
                if receptacle in movable:
                    continue
                spots[errand.scene].add((receptacle, spot))
                if kind and kind not in picked:
                    picked.add(kind)
                    found[errand.room, kind][receptacle] += 1
    if not errands:
        raise FileError(paths[0], "no demonstrations in it")
    places = {scene: Counter(kind for kind, _ in at) for scene, at in spots.items()}
    source = "ALFRED, " + ", ".join(path.name.split(".")[0] for path in paths)
    return Pool(source=source, errands=tuple(errands), finds=Finds(places=places, found=found))


def _handled(trial: _Trial) -> Iterator[tuple[str, str, str]]:
    """Yield what is picked up ("" for what is put down), from which receptacle, and its place."""
    for act in (step.planner_action for step in trial.plan.high_pddl):
        where = act.coordinate_receptacle_object_id
        if where and act.action in ("PickupObject", "PutObject"):
            kind = root_type(act.object_id or "") if act.action == "PickupObject" else ""
            yield kind, where[0], str(where[1:])


def _errand(trial: _Trial, path: Path) -> Errand:
    wanted, plan = trial.pddl_params, trial.scene.floor_plan
    number = plan.removeprefix("FloorPlan")
    room = _FLOOR_PLANS.get(int(number) // 100) if number.isdigit() else None
    if room is None:
        raise FileError(path, f"{plan!r} is no floor plan of ALFRED's")
    subjects = _distinct((wanted.object_target, wanted.mrecep_target))
    knives = [
        kind
        for step in trial.plan.high_pddl
        if wanted.object_sliced and step.planner_action.action == "PickupObject"
        if (kind := root_type(step.planner_action.object_id or "")) in KNIVES
    ]
    return Errand(
        scene=plan,
        room=room,
        r4=_distinct((*subjects, wanted.toggle_target, wanted.parent_target)),
        m=_distinct((*subjects, *knives)),
        subjects=subjects,
    )


def _distinct(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(base_type(name) for name in names if name))


# ------------------------------------------------------------- tasks of our own


@lru_cache(maxsize=4)
def grammar_pool(seed: int, *, scenes: int = GRAMMAR_SCENES, tasks: int = GRAMMAR_TASKS) -> Pool:
    """Return requests of our task grammar in generated rooms, each about a thing to carry."""
    from karma.bench.drawing.memories import room_of
    from karma.bench.drawing.phrases import our_book
    from karma.world.generation.generate import build_scene

    errands: list[Errand] = []
    places: dict[str, Counter[str]] = {}
    found: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for kind, number in product(ROOMS, range(scenes)):
        scene = build_scene(kind, 2000 + number, seed)
        name = f"{kind}_{number}"
        types = {thing.id: thing.type for thing in scene.objects}
        movable = {t.id for t in scene.objects if "pickupable" in t.capabilities}
        here = places[name] = Counter()
        for thing in scene.objects:
            if "receptacle" in thing.capabilities and thing.id not in movable:
                here[thing.type] += 1
            if thing.id in movable and thing.parents and thing.parents[0] not in movable:
                found[kind, thing.type][types[thing.parents[0]]] += 1
        errands += _requests(room_of(scene, name, seed=seed), our_book(), kind, seed, tasks)
    if not errands:
        raise KarmaError("the rooms give no task; draw more of them")
    finds = Finds(places=places, found=found)
    return Pool(source=f"our task grammar, seed {seed}", errands=tuple(errands), finds=finds)


def _requests(
    room: "KnownRoom", book: "Book", kind: str, seed: int, count: int
) -> Iterator[Errand]:
    """Yield requests about something to carry."""
    from karma.bench.drawing.drawn_tasks import draw_task

    movable = types_with("pickupable")
    for number in range(count):
        rng = stream(seed, "lab", "grammar", room.name, str(number))
        steps = draw_task(rng, room, book, "simple")
        if not steps:
            continue
        goals = steps[0].goals
        named = [word for goal in goals for word in goal.arguments if word[:1].isupper()]
        r4 = _distinct(named)
        carried = tuple(name for name in r4 if name in movable)
        cuts = any(goal.arguments[-1] == "sliced" for goal in goals)
        knives = [one for one in KNIVES if one in room.movables][: int(cuts)]
        if carried:
            yield Errand(
                scene=room.name,
                room=kind,
                r4=r4,
                m=_distinct((*carried, *knives)),
                subjects=carried,
            )
