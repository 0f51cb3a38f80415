"""The symbolic teacher acting with the whole truth: the ceiling, and proof that tasks are solvable.

The one method that may read a sub-task's goals and the world's hidden state.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from karma.agent.skills import Skills
from karma.contracts import (
    Area,
    Event,
    Goal,
    Known,
    Outcome,
    Plan,
    Resources,
    SceneRef,
    SkillCall,
    SkillResult,
    SubTask,
    World,
)
from karma.household.ids import whole_id
from karma.household.pieces import base_type, is_piece
from karma.household.places import HAND, SURFACES
from karma.household.uses import SINK
from karma.methods.options import settings_of
from karma.tasks.expert import Thing, View, solve
from karma.tasks.goals import GoalTracker, WatchedWorld, alternatives, is_position, object_names

ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class _NoOptions:
    pass


class OracleMethod:
    """The `oracle` row: goals and truth in, programs out, through the same skills."""

    name = "oracle"

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row; it has no options."""
        settings_of(_NoOptions, options)
        return cls()

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "OracleEpisode":
        """Start an episode; nothing is kept from an earlier one."""
        return OracleEpisode(world, scene)


class OracleEpisode:
    """One sequence of instructions; what was used in each room is known.

    Args:
        world: has been reset to `scene`.
        scene: the first room.
    """

    def __init__(self, world: World, scene: SceneRef) -> None:
        self._tracker = GoalTracker()
        self._world = WatchedWorld(world, self._tracker)
        self._used: list[str] = []  # ids of this room, the last used last
        self._used_in = {scene: self._used}
        self._tracker.start(world.last_event)

    def enter(self, scene: SceneRef) -> None:
        """Be in a room; what was used in it before is known."""
        self._used = self._used_in.setdefault(scene, [])
        self._tracker.start(self._world.last_event)

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Solve what is not true yet, and again if something went wrong."""
        if subtask.is_whole:
            self._tracker.start(self._world.last_event)
        self._tracker.begin_subtask()
        truth = _Truth(self._world)
        skills = Skills(self._world, truth)
        handled: list[str] = []
        unmet = self._tracker.unmet(subtask.goals, self._world.last_event)
        for _ in range(ATTEMPTS):
            for call in self._program(unmet):
                result = skills.run(call)
                handled += result.object_ids
                yield result
                if not result.ok:
                    break
            self._used += handled
            unmet = self._tracker.unmet(subtask.goals, self._world.last_event)
            if not unmet:
                break
        yield Outcome(finished=not unmet, resident=(), handled_ids=tuple(handled))

    def _program(self, goals: tuple[Goal, ...]) -> tuple[SkillCall, ...]:
        """Write the program for goals whose names are bound to objects of the scene."""
        if not goals:
            return ()
        view, ids = _view(self._world.last_event, self._used)
        bound = [_bound(goal, view, ids) for goal in goals]
        return solve(bound, view)


class _Truth:
    """Knowledge of where everything is."""

    def __init__(self, world: World) -> None:
        self._world = world

    def where(self, name: str) -> Known | None:
        """Return the object of that id, or the nearest of that type."""
        things = self._world.last_event.metadata["objects"]
        fitting = [thing for thing in things if name in (thing["objectId"], thing["objectType"])]
        if not fitting:
            return None
        thing = min(fitting, key=lambda thing: (thing["distance"], thing["objectId"]))
        return Known(
            object_id=thing["objectId"],
            object_type=thing["objectType"],
            position_m=tuple(thing["position"][axis] for axis in "xyz"),
            place_id=next(iter(_parents(thing)), None),
        )

    def areas(self) -> tuple[Area, ...]:
        """Return (): who knows everything need not search."""
        return ()


def _view(event: Event, used: list[str]) -> tuple[View, Mapping[str, Mapping[str, Any]]]:
    """Return everything as the teacher sees it, the last used things first."""
    things = {thing["objectId"]: thing for thing in event.metadata["objects"]}
    rank = {object_id: number for number, object_id in enumerate(used)}
    pieces = {whole_id(object_id) for object_id, t in things.items() if is_piece(t["objectType"])}
    order = sorted(
        (t for t in things.values() if t["objectId"] not in pieces),
        key=lambda t: (-rank.get(t["objectId"], -1), t["distance"], t["objectId"]),
    )
    held = {item["objectId"] for item in event.metadata["inventoryObjects"]}
    fixed = tuple(sorted({t["objectType"] for t in things.values()}))
    view = View(
        things=tuple(_thing(t, things) for t in order),
        areas=(Area(name="everywhere", position_m=(0.0, 0.0, 0.0), contains=fixed),),
        held=next((_thing(things[object_id], things) for object_id in held), None),
    )
    return view, things


def _thing(thing: Mapping[str, Any], things: Mapping[str, Mapping[str, Any]]) -> Thing:
    place = next(iter(_parents(thing)), None)
    closed = place is not None and things[place]["openable"]
    return Thing(
        name=thing["objectId"],
        object_type=thing["objectType"],
        states=("sliced",) if is_piece(thing["objectType"]) else (),
        place=place if closed else None,
        place_type=things[place]["objectType"] if closed and place else None,
    )


def _parents(thing: Mapping[str, Any]) -> list[str]:
    return [parent for parent in thing["parentReceptacles"] or () if parent != HAND]


def _bound(goal: Goal, view: View, things: Mapping[str, Mapping[str, Any]]) -> Goal:
    """Put ids in place of the names of things that can be carried; places keep their type."""
    names = object_names(goal)
    arguments = list(goal.arguments)
    for place, argument in enumerate(arguments):
        if argument not in names:
            continue
        arguments[place] = _choose(alternatives(argument), view, things)
    if goal.predicate == "ON":
        arguments[1] = _support(arguments[1], things)
    return Goal(predicate=goal.predicate, arguments=tuple(arguments))


def _support(name: str, things: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the receptacle for "near": what a thing lies on, or what a place "(x, y, z)" is at."""
    if is_position(name):
        point = [float(part) for part in name.strip("() ").split(",")]
        open_ones = (t for t in things.values() if t["receptacle"] and not t["openable"])
        return str(min(open_ones, key=lambda t: _off(t, point))["objectId"])
    thing = things.get(name)
    return name if thing is None or thing["receptacle"] else next(iter(_parents(thing)), name)


def _off(thing: Mapping[str, Any], point: Sequence[float]) -> float:
    """Return the squared distance of a point from a thing's box, m2."""
    box = thing["axisAlignedBoundingBox"]
    gaps = (
        max(abs(p - box["center"][axis]) - box["size"][axis] / 2, 0.0)
        for p, axis in zip(point, "xyz", strict=True)
    )
    return float(sum(gap * gap for gap in gaps))


def _choose(names: tuple[str, ...], view: View, things: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the id of what was last used, else the nearest; big fixed things stay a type."""
    for name in names:
        held = view.held
        if held is not None and name in (held.name, base_type(held.object_type)):
            return held.name
        for thing in view.things:
            if name in (thing.name, base_type(thing.object_type)):
                movable = things[thing.name]["pickupable"]
                return thing.name if movable or name not in (*SURFACES, SINK) else name
    return names[0]
