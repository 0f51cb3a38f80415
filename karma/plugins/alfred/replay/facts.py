"""Gather what is known of the rooms: ALFRED's side files, AI2-THOR's dump, and the trials.

A trial tells of its room: the cells its demonstrator walked on, the ids of what it handled, and
the planner's coordinates, which give receptacles to a millimetre and say what lay in them.
"""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import msgspec

from karma.household.ids import made_at, part_id, type_of
from karma.household.uses import WHOLE_OF, without_basin
from karma.plugins.alfred.replay.steps import named, visited
from karma.plugins.alfred.replay.trial import (
    PlannerAction,
    Spot,
    Trial,
    object_id,
    read_table,
    spelt_out,
)
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.types.space import Vec3
from karma.world.core.scene import Scene, SceneObject

SAME_M = 0.03  # two places of one type that are one object, where ids carry centimetres
_BASIN_M = 1.0  # between a basin and the sink or tub whose place its id carries


class RoomLayout(msgspec.Struct, frozen=True, kw_only=True):
    """What ALFRED's layouts tell of a room: cells (x, z), types, poses to see receptacles from."""

    reachable: tuple[tuple[float, float], ...] = ()
    object_types: tuple[str, ...] = ()
    receptacle_points: dict[str, tuple[float, ...]] = {}


class FixedObject(msgspec.Struct, frozen=True, kw_only=True):
    """A fixed object; its place to better than the centimetre of its id, where known."""

    pos: Vec3 | None = None


class FixedObjects(msgspec.Struct, frozen=True, kw_only=True):
    """The fixed objects of a room by id."""

    fixed: dict[str, FixedObject]


class Receptacle(msgspec.Struct, frozen=True, kw_only=True):
    """One fixed receptacle of a room."""

    type: str
    pos: Vec3
    id: str | None = None


class LabelledSpot(NamedTuple):
    """Where an object of some trial lay, and the receptacle that the planner names for it."""

    x: float
    y: float
    z: float
    receptacle: str
    trial: str
    thing: str


class Spots(msgspec.Struct, frozen=True, kw_only=True):
    """The labelled positions by FloorPlan."""

    spots: dict[str, tuple[LabelledSpot, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Files:
    """The side files; None = none."""

    layouts: Path | None = None
    dumps: Path | None = None
    fixed: Path | None = None
    receptacles: Path | None = None
    spots: Path | None = None


_USUAL = {
    "layouts": "alfred/layouts.json.gz",
    "dumps": "thor5/scenes.jsonl.gz",
    "fixed": "alfred/scenes_fixed.json.gz",
    "receptacles": "alfred/receptacle_instances.json.gz",
    "spots": "alfred/labelled_spots.json.gz",
}


def side_files(**given: str | None) -> Files:
    """Return the side files to read, given by the fields of `Files`; "none" = do not read one.

    Where none is given it is the usual one below $KARMA_SHARED, or `../shared`, if it is there.
    """
    root = Path(os.environ.get("KARMA_SHARED", "../shared")) / "data"
    there = {name: root / usual for name, usual in _USUAL.items() if (root / usual).is_file()}
    named = {name: Path(path) for name, path in given.items() if path is not None}
    found = there | named
    return Files(**{name: path for name, path in found.items() if str(path) != "none"})


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomFacts:
    """What is known of one FloorPlan, whatever the trial."""

    name: str
    cells: tuple[tuple[float, float], ...]  # sorted
    fixed: Mapping[str, Vec3]  # id -> where its origin is, metres
    spots: tuple[LabelledSpot, ...]
    dump: Scene | None
    types: frozenset[str] = frozenset()  # that the room has; empty = not known
    models: Mapping[str, SceneObject] = field(default_factory=dict)  # one of each type, of any dump


def gather(trials: Iterable[Trial], files: Files) -> dict[str, RoomFacts]:
    """Return the facts of every FloorPlan that the trials play in.

    Raises:
        FileError: a side file is missing, torn, or of the wrong form.
    """
    rooms: dict[str, list[Trial]] = {}
    for trial in trials:
        rooms.setdefault(trial.scene.floor_plan, []).append(trial)
    layouts = read_table(files.layouts, dict[str, RoomLayout]) if files.layouts else {}
    fixed = read_table(files.fixed, dict[str, FixedObjects]) if files.fixed else {}
    of_rooms = dict[str, tuple[Receptacle, ...]]
    receptacles = read_table(files.receptacles, of_rooms) if files.receptacles else {}
    spots = read_table(files.spots, Spots).spots if files.spots else {}
    dumps = {scene.name: scene for scene in import_dump(files.dumps)} if files.dumps else {}
    models = _models(dumps.values())
    found = {}
    for name, played in sorted(rooms.items()):
        layout = layouts.get(name, RoomLayout())
        places = _places(layout, fixed.get(name), receptacles.get(name, ()))
        places, own = _with_trials(places, played)
        cells = {cell for trial in played for cell in visited(trial)}
        cells.update((float(x), float(z)) for x, z in layout.reachable)
        found[name] = RoomFacts(
            name=name,
            cells=tuple(sorted(cells)),
            fixed=places,
            spots=_distinct((*spots.get(name, ()), *own)),
            dump=dumps.get(name),
            types=frozenset(layout.object_types),
            models=models,
        )
    return found


def _models(scenes: Iterable[Scene]) -> dict[str, SceneObject]:
    """Return of each type the object of middling volume."""
    found: dict[str, list[SceneObject]] = {}
    for scene in scenes:
        for thing in scene.objects:
            found.setdefault(thing.type, []).append(thing)
    ranked = ((kind, middling(things)) for kind, things in sorted(found.items()))
    return {kind: model for kind, model in ranked if model is not None}


def middling(things: Iterable[SceneObject]) -> SceneObject | None:
    """Return the object of middling volume, of two the smaller; None of none."""
    ranked = sorted(things, key=lambda thing: (math.prod(thing.size), thing.id))
    return ranked[(len(ranked) - 1) // 2] if ranked else None


def _distinct(spots: Iterable[LabelledSpot]) -> tuple[LabelledSpot, ...]:
    """Drop what is told twice, by the file and by the trial."""
    found = {(spot.trial, spot.thing): spot for spot in spots}
    return tuple(spot._replace(receptacle=spelt_out(spot.receptacle)) for spot in found.values())


# ----------------------------------------------------------------- fixed objects


def _places(
    layout: RoomLayout, fixed: FixedObjects | None, receptacles: Sequence[Receptacle]
) -> dict[str, Vec3]:
    """Return the ids that the side files know, with the best place each has."""
    found: dict[str, Vec3] = {}
    known: list[tuple[str, Vec3 | None]] = [(one, None) for one in layout.receptacle_points]
    known += [(spelt_out(one.id or object_id(one.type, one.pos)), one.pos) for one in receptacles]
    known += [(one, facts.pos) for one, facts in (fixed.fixed if fixed else {}).items()]
    for one, position in known:
        _add(found, one, position)
    return found


def _add(found: dict[str, Vec3], one: str, position: Vec3 | None) -> None:
    """Note an id; a place told outright is better than the one the id carries."""
    place = position or found.get(one) or made_at(one)
    if place is not None:
        found[one] = place


def _with_trials(
    places: dict[str, Vec3], trials: Sequence[Trial]
) -> tuple[dict[str, Vec3], tuple[LabelledSpot, ...]]:
    """Return the places with what trials add, and what the trials label."""
    movable = {pose.id for trial in trials for pose in trial.scene.object_poses}
    for trial in trials:
        known: list[tuple[str, Vec3 | None]] = [(one, None) for one in named(trial)]
        for goal in trial.plan.high_pddl:
            known += ((one, at.position) for one, at in _named_spots(goal.planner_action))
        for one, position in known:
            if one not in movable:
                _add(places, one, position)
    labels = [label for trial in trials for label in _labels(places, trial)]
    return places, tuple(labels)


def _named_spots(step: PlannerAction) -> Iterator[tuple[str, Spot]]:
    """Yield the ids that a sub-goal names with their exact places."""
    for one in filter(None, (step.object_id, step.receptacle_object_id)):
        for spot in filter(None, (step.thing, step.receptacle)):
            place = made_at(one)
            reach = _BASIN_M if spot.kind in WHOLE_OF else SAME_M
            if type_of(one) == spot.kind and place and math.dist(place, spot.position) <= reach:
                yield one, spot


def _labels(places: dict[str, Vec3], trial: Trial) -> Iterator[LabelledSpot]:
    """Yield where the planner says that things lay, at the first time each is picked up."""
    poses = {pose.id: pose for pose in trial.scene.object_poses}
    seen: set[str] = set()
    for goal in trial.plan.high_pddl:
        step = goal.planner_action
        one, spot = step.object_id, step.receptacle
        if step.action == "PutObject" and one:
            seen.add(one)
        if step.action != "PickupObject" or one not in poses or one in seen or spot is None:
            continue
        seen.add(one)
        x, y, z = poses[one].position.tuple
        yield LabelledSpot(x, y, z, _resolved(places, spot), trial.id, one)


def _resolved(places: dict[str, Vec3], spot: Spot) -> str:
    """Return the id of the receptacle at a place; a new one is noted when nothing is known there.

    Ids of basins carry the place of their sink or tub.
    """
    far = {
        one: math.dist(place, spot.position)
        for one, place in places.items()
        if type_of(one) == spot.kind
    }
    nearest = min(far, key=lambda one: (far[one], one), default=None)
    reach = _BASIN_M if spot.kind in WHOLE_OF else SAME_M
    if nearest is not None and far[nearest] <= reach:
        return nearest
    one = object_id(without_basin(spot.kind), spot.position)
    if spot.kind in WHOLE_OF:
        one = part_id(one, spot.kind)
    _add(places, one, spot.position)
    return one
