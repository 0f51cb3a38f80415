"""The `expert` row: knows all objects and goals; shows the ceiling and that tasks can be solved.

The one method that may read a sub-task's goals and the world's hidden state.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from karma.agent.perceive import truth_of
from karma.agent.skills import Skills
from karma.contracts import (
    Area,
    Goal,
    Known,
    Outcome,
    Plan,
    Resources,
    SceneRef,
    SkillCall,
    SkillResult,
    SubTask,
    TrueObject,
    Truth,
    Vec3,
    World,
)
from karma.household.ids import whole_id
from karma.household.pieces import base_type, is_piece
from karma.household.places import SURFACES
from karma.household.uses import SINK, with_wholes
from karma.methods.options import settings_of
from karma.tasks.expert import ExpertView, NamedThing, solve
from karma.tasks.goals import GoalTracker, WatchedWorld, alternatives, is_position, object_names

ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class _NoOptions:
    pass


class ExpertMethod:
    """Writes programs from the goals and the true state, and acts by the same skills as others."""

    name = "expert"

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row; it has no options."""
        settings_of(_NoOptions, options)
        return cls()

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "ExpertEpisode":
        """Start an episode; nothing is kept from an earlier one."""
        return ExpertEpisode(world, scene)


class ExpertEpisode:
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
        """Go on in a room, with the ids of what was used there before."""
        self._used = self._used_in.setdefault(scene, [])
        self._tracker.start(self._world.last_event)

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Act until all goals hold, writing at most `ATTEMPTS` programs."""
        if subtask.is_whole:
            self._tracker.start(self._world.last_event)
        self._tracker.begin_subtask(subtask, self._world.last_event)
        skills = Skills(self._world, _AllKnowing(self._world))
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
        view, ids = _view(truth_of(self._world.last_event), self._used)
        bound = [_bound(goal, view, ids) for goal in goals]
        return solve(bound, view)


class _AllKnowing:
    """Answers the skills' questions from the true state."""

    def __init__(self, world: World) -> None:
        self._world = world

    def where(self, name: str) -> Known | None:
        """Return the object of that id, or the nearest of that type."""
        things = truth_of(self._world.last_event).objects
        fitting = [thing for thing in things if name in (thing.object_id, thing.object_type)]
        if not fitting:
            return None
        thing = min(fitting, key=lambda thing: (thing.distance_m, thing.object_id))
        return Known(
            object_id=thing.object_id,
            object_type=thing.object_type,
            position_m=thing.position_m,
            place_id=next(iter(thing.parent_ids), None),
        )

    def areas(self) -> tuple[Area, ...]:
        """Return no areas: with everything known nothing is searched for."""
        return ()


def _view(truth: Truth, used: list[str]) -> tuple[ExpertView, Mapping[str, TrueObject]]:
    """Return everything as the expert sees it, the last used things first."""
    things = {thing.object_id: thing for thing in truth.objects}
    rank = {object_id: number for number, object_id in enumerate(used)}
    pieces = {whole_id(object_id) for object_id, t in things.items() if is_piece(t.object_type)}
    order = sorted(
        (t for t in things.values() if t.object_id not in pieces),
        key=lambda t: (-rank.get(t.object_id, -1), t.distance_m, t.object_id),
    )
    fixed = tuple(sorted(with_wholes(t.object_type for t in things.values())))
    view = ExpertView(
        things=tuple(_thing(t, things) for t in order),
        areas=(Area(name="everywhere", position_m=(0.0, 0.0, 0.0), contains=fixed),),
        held=next((_thing(things[object_id], things) for object_id in truth.held_ids), None),
    )
    return view, things


def _thing(thing: TrueObject, things: Mapping[str, TrueObject]) -> NamedThing:
    place = things[thing.parent_ids[0]] if thing.parent_ids else None
    closed = place if place is not None and place.openable else None
    return NamedThing(
        name=thing.object_id,
        object_type=thing.object_type,
        states=("sliced",) if is_piece(thing.object_type) else (),
        place=closed.object_id if closed else None,
        place_type=closed.object_type if closed else None,
    )


def _bound(goal: Goal, view: ExpertView, things: Mapping[str, TrueObject]) -> Goal:
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


def _support(name: str, things: Mapping[str, TrueObject]) -> str:
    """Return a receptacle: of a thing, what it lies on; of a point "(x, y, z)", the nearest."""
    if is_position(name):
        x, y, z = (float(part) for part in name.strip("() ").split(","))
        open_ones = (t for t in things.values() if t.receptacle and not t.openable)
        return min(open_ones, key=lambda t: _off(t, (x, y, z))).object_id
    thing = things.get(name)
    return name if thing is None or thing.receptacle else next(iter(thing.parent_ids), name)


def _off(thing: TrueObject, point: Vec3) -> float:
    """Return the squared distance of a point from a thing's box, m2."""
    box = zip(point, thing.box_center_m, thing.box_size_m, strict=True)
    gaps = (max(abs(p - center) - size / 2, 0.0) for p, center, size in box)
    return float(sum(gap * gap for gap in gaps))


def _choose(names: tuple[str, ...], view: ExpertView, things: Mapping[str, TrueObject]) -> str:
    """Return the id of the thing last used, else of the nearest; surfaces keep their type."""
    for name in names:
        held = view.held
        if held is not None and name in (held.name, base_type(held.object_type)):
            return held.name
        for thing in view.things:
            if name in (thing.name, base_type(thing.object_type)):
                movable = things[thing.name].pickupable
                return thing.name if movable or name not in (*SURFACES, SINK) else name
    return names[0]
