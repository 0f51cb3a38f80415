"""Rooms as an agent knows them, and short-term memory after requests."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from karma.agent.planning.prompt import compact
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import HAND, ROOMS, landmark_types
from karma.household.states import END_STATES, OPPOSITES
from karma.household.types import object_types
from karma.household.uses import CHANGED_IN, FRIDGE, KNIFE
from karma.memory.scene_graph import SceneGraph
from karma.plugins.rooms.generate import build_scene
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.seeds import stream
from karma.types.memory import Area, MemoryUnit
from karma.types.observation import SeenObject
from karma.types.planning import PlanRequest
from karma.types.tasks import Goal
from karma.world.core.scene import Scene

Rng = np.random.Generator
T = TypeVar("T")
CAPACITY = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownRoom:
    """Room knowledge for sampling: area nodes and the types of movable objects."""

    name: str
    areas: tuple[Area, ...]
    movables: tuple[str, ...]
    several: tuple[str, ...] = ()  # those of which there are two or more

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Return the immovable types that requests can name, sorted."""
        return tuple(sorted({k for a in self.areas for k in a.contains} & landmark_types()))


def pick(rng: Rng, items: Sequence[T]) -> T:
    """Sample an item; `rng.choice` would copy the sequence into an array."""
    return items[int(rng.integers(len(items)))]


def weighted(rng: Rng, odds: Mapping[str, float]) -> str:
    """Sample a key by its weight."""
    roll = rng.random() * sum(odds.values())
    for name, weight in odds.items():
        roll -= weight
        if roll < 0:
            return name
    return list(odds)[-1]


def unit_of(object_id: str, object_type: str, **said: Any) -> MemoryUnit:
    """Return a unit at the origin."""
    return MemoryUnit(
        object_id=object_id, object_type=object_type, position_m=(0.0, 0.0, 0.0), **said
    )


def known_facts(
    areas: Sequence[Area], units: Sequence[MemoryUnit], held: MemoryUnit | None, said: str = ""
) -> PlanRequest:
    """Return the planning request of an agent with this knowledge."""
    return PlanRequest(
        instruction=said,
        areas=tuple(areas),
        units=tuple(units),
        held_id=held.object_id if held else None,
        held_type=held.object_type if held else None,
    )


def names_of(facts: PlanRequest) -> dict[str, str]:
    """Return the prompt's names of remembered objects by id."""
    return {object_id: name for name, object_id in compact(facts).names.items()}


def place_type(units: Sequence[MemoryUnit], place: str) -> str:
    """Return a receptacle's type, from its unit or from its id."""
    return next((u.object_type for u in units if u.object_id == place), type_of(place))


KITCHEN_SHARE = 3  # kitchens per room of another kind, as most requests are about kitchens
AUTHORS_PLANS = frozenset({1, 11, 14, 16, 19, 22, 23, 27, 28, 201, 203, 207, 224, 314, 417, 422})


def room_of(scene: Scene, name: str, *, keep: float = 0.93, seed: int = 0) -> KnownRoom:
    """Return the knowledge of an agent that explored a scene and missed a few objects.

    `name` names the random stream; `keep` is the chance that an immovable thing was noticed.
    """
    rng = stream(seed, "rooms", name)
    graph = SceneGraph.over(scene.reachable, height_m=scene.floor_y, cell_m=scene.grid_m)
    graph.observe(
        SeenObject(
            object_id=thing.id,
            object_type=thing.type,
            position_m=thing.position,
            box_center_m=thing.center,
            box_size_m=thing.size,
            pickupable=False,
        )
        for thing in scene.objects
        if "pickupable" not in thing.capabilities and rng.random() < keep
    )
    movables = Counter(
        base_type(thing.type) for thing in scene.objects if "pickupable" in thing.capabilities
    )
    return KnownRoom(
        name=name,
        areas=graph.areas(),
        movables=tuple(sorted(movables)),
        several=tuple(sorted(kind for kind, count in movables.items() if count > 1)),
    )


def generated_rooms(count: int, seed: int) -> Iterator[KnownRoom]:
    """Yield generated rooms; no seed is that of a shipped scene."""
    order = [ROOMS[0]] * KITCHEN_SHARE + list(ROOMS[1:])
    for number in range(count):
        kind = order[number % len(order)]
        scene = build_scene(kind, 1000 + number, seed)
        yield room_of(scene, f"generated/{seed}/{number}", seed=seed)


def imported_rooms(dumps: Path, layouts: Path | None, seed: int) -> Iterator[KnownRoom]:
    """Yield AI2-THOR's floor plans, without those of the authors' tasks."""
    for scene in import_dump(dumps, layouts=layouts):
        if not is_authors_plan(scene.name):
            yield room_of(scene, scene.name, seed=seed)


def is_authors_plan(name: str) -> bool:
    """Return whether the authors' tasks use a floor plan; training excludes these."""
    return int(name.removeprefix("FloorPlan").split("_")[0]) in AUTHORS_PLANS


def subject(goal: Goal) -> str:
    """Return the type of a goal's object."""
    return base_type(goal.arguments[1] if goal.predicate == "HOLDON" else goal.arguments[0])


def after(unit: MemoryUnit, goal: Goal) -> MemoryUnit:
    """Return a unit after a goal about its object is met."""
    word = goal.arguments[-1]
    if goal.predicate in ("ON", "INSIDE"):
        return replace(unit, place_id=word)
    if goal.predicate == "HOLDON":
        return replace(unit, place_id=HAND)
    if goal.predicate != "STATE":
        word = END_STATES[goal.predicate]
    state = {"clean": "cleaned", "cold": ""}.get(word, word)
    states = [s for s in unit.states if s not in (state, OPPOSITES.get(state))]
    kind = object_types()[unit.object_type]
    if state == "cleaned" and "canFillWithLiquid" in kind.capabilities:
        states.append("filled")
    return replace(
        unit,
        object_type=(kind.slices_into or unit.object_type) if state == "sliced" else kind.name,
        states=(*states, *([state] if state else [])),
        place_id=FRIDGE if word == "cold" else CHANGED_IN.get(state, unit.place_id),
        handled=True,
    )


class RequestHistory:
    """Short-term memory after requests: a unit per object type, the last used last."""

    def __init__(self) -> None:
        self.units: list[MemoryUnit] = []

    @property
    def held(self) -> MemoryUnit | None:
        """The unit in the hand, if any."""
        return next((unit for unit in self.units if unit.place_id == HAND), None)

    def known(self, object_type: str) -> MemoryUnit | None:
        """Return the unit of a type or of its pieces, or None."""
        return next((u for u in self.units if base_type(u.object_type) == object_type), None)

    def apply(self, goals: Iterable[Goal]) -> None:
        """Record the effects of goals that were met; goals that count two leave no unit."""
        for goal in goals:
            name = subject(goal)
            if goal.count == 1 and "pickupable" in object_types()[name].capabilities:
                self._apply(name, goal)

    def _apply(self, name: str, goal: Goal) -> None:
        unit = self.known(name) or unit_of(name, name, handled=True)
        self.units = [other for other in self.units if other.object_id != unit.object_id]
        changed = after(unit, goal)
        if goal.predicate in ("ON", "INSIDE", "HOLDON") or changed.place_id == HAND:
            self._empty_hand()
        if changed.object_type != unit.object_type or goal.arguments[-1] == "sliced":
            self.units = [other for other in self.units if other.object_type != KNIFE]
            self.units.append(unit_of(KNIFE, KNIFE, place_id=HAND, handled=True))
        if goal.arguments[-1] != "broken":
            self.units.append(changed)
        place = goal.arguments[-1]
        into = goal.predicate in ("ON", "INSIDE") and self.known(place) is None
        if into and "pickupable" in object_types()[place].capabilities:  # a dish
            self.units.append(unit_of(place, place, handled=True))

    def _empty_hand(self) -> None:
        self.units = [
            replace(unit, place_id=None) if unit.place_id == HAND else unit for unit in self.units
        ]
