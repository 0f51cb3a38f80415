"""Find a free place on a surface, in a container or below a hand, and what it is part of.

Boxes only. A place is looked for with full clearance first, then with less, because a meal's
worth of plates does fit a table whose boxes claim otherwise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.types.space import Vec3
from karma.world.core.boxes import Flags, Floats
from karma.world.core.hiding import blocking, inert_rows, solid_boxes
from karma.world.core.objects import Objects
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import Room, WorldState
from karma.world.core.thing import bottom, is_inert, is_loose, is_movable, is_shut, top
from karma.world.core.view import boxes_round, camera, camera_axes, in_picture

_LIFT_M = 0.002  # above what it rests on
_STEP_M = 0.06  # between the places tried
_MOST = 16  # places tried along one side
_AT_ONCE = 32  # places compared with all boxes at once
_OVERHANG_IN, _OVERHANG_ON = 1.5, 2.5  # a thing's size over its place's, at most
_LEVEL_M = 0.03  # heights closer than this are one
_INSIDE_M = 0.05  # what lies in a drawer lies so far above its lower side, at most
_TALL_M = 0.8  # a container higher than this has boards at these shares of its height
_BOARDS = (0.35, 0.6, 0.1)


class _Try(NamedTuple):
    """How generous a round of the search is."""

    clearance: float  # share of the thing's box that has to be free
    strangers: bool  # whether things outside the receptacle count
    standing: bool  # whether places above cells to stand on are barred


_ROUNDS = (
    _Try(1.0, True, True),
    _Try(0.9, False, True),
    _Try(0.9, False, False),
    _Try(0.5, False, False),
)


def find_place(state: WorldState, thing: SceneObject, receptacle: SceneObject) -> Vec3 | None:
    """Return where the middle of a thing's box comes to be in or on a receptacle that takes it.

    It is the free place nearest to the agent, one in its picture if there is one; None when the
    receptacle is full or too small.
    """
    if object_types()[receptacle.type].accepts_only:
        return _attach(state, thing, receptacle)
    if _too_big(thing, receptacle):
        return None
    levels = _levels(state.objects, thing, receptacle)
    places = _grid(thing, receptacle)
    agent = np.array(state.pose.position_m)[[0, 2]]
    far = np.round(np.linalg.norm(places - agent, axis=1), 4)
    places = places[np.lexsort((places[:, 1], places[:, 0], far))]
    shown = [_in_picture(state, places, resting(thing, level)) for level in levels]
    tries = [(level, places[inside]) for level, inside in zip(levels, shown, strict=True)]
    tries += [(level, places[~inside]) for level, inside in zip(levels, shown, strict=True)]
    for attempt in _ROUNDS:
        barred = _obstacles(state, receptacle, strangers=attempt.strangers)
        for level, some in tries:
            found = _first_free(state, thing, receptacle, some, level, attempt, barred)
            if found is not None:
                return (round(found[0], 5), resting(thing, level), round(found[1], 5))
    return None


def _in_picture(state: WorldState, places: Floats, height: float) -> Flags:
    """Return which places, shape (n, 2), at a height the agent has in its picture."""
    points = np.insert(places, 1, height, axis=1) - np.array(camera(state.pose))
    axes = camera_axes(state.pose.yaw_deg, state.pose.horizon_deg)
    return in_picture(points, axes, state.settings.fov_deg, state.settings.aspect)


def _attach(state: WorldState, thing: SceneObject, receptacle: SceneObject) -> Vec3 | None:
    """Return the one place of a burner, toaster, coffee machine or hanger; None when taken."""
    if not all(map(is_inert, _lying_in(state.objects, receptacle))):
        return None
    inside = receptacle.type in rules().put.inside
    level = bottom(receptacle) if inside else top(receptacle)
    return (receptacle.center[0], resting(thing, level), receptacle.center[2])


def resting(thing: SceneObject, level: float) -> float:
    """Return the height of a thing's middle when it rests at a level."""
    return round(level + _LIFT_M + thing.size[1] / 2, 5)


def _too_big(thing: SceneObject, receptacle: SceneObject) -> bool:
    """Return whether a thing cannot even stick out: its shorter sides are wider than the room."""
    item, room = sorted(thing.size), sorted((receptacle.size[0], receptacle.size[2]))
    share = _OVERHANG_IN if receptacle.type in rules().view.hides_when_closed else _OVERHANG_ON
    return item[0] > room[0] * share or item[1] > room[1] * share


def _levels(objects: Objects, thing: SceneObject, receptacle: SceneObject) -> list[float]:
    """Return heights to rest on, the one most in use first."""
    put = rules().put
    low, high = bottom(receptacle), top(receptacle)
    used = _in_use(objects, receptacle)
    if receptacle.type not in put.inside:
        return used[:1] or [high]
    height = high - low
    own = [low + height * share for share in _BOARDS] if height > _TALL_M else [low]
    found = used + own
    if receptacle.type in put.open_top:
        return found + _piled(objects, receptacle)
    fits = [level for level in found if level + thing.size[1] <= high + 0.02]
    return fits or [low]


def _in_use(objects: Objects, receptacle: SceneObject) -> list[float]:
    """Return the heights at which things lie in a receptacle, the most common first."""
    low, high = bottom(receptacle), top(receptacle)
    used = [bottom(one) for one in _lying_in(objects, receptacle) if is_movable(one)]
    return _common([level for level in used if low - 0.05 <= level <= high + 0.05])


def _lying_in(objects: Objects, receptacle: SceneObject) -> list[SceneObject]:
    return [objects[child] for child in objects.containment.children.get(receptacle.id, ())]


def _piled(objects: Objects, receptacle: SceneObject) -> list[float]:
    """Return the heights on top of what lies in a receptacle, below its rim, the lowest first."""
    tops = {top(one) for one in _lying_in(objects, receptacle) if is_movable(one)}
    return sorted(level for level in tops if level < top(receptacle))


def _common(levels: Sequence[float]) -> list[float]:
    """Return distinct heights, the most common first."""
    groups: list[list[float]] = []
    for level in sorted(levels):
        if groups and level - groups[-1][0] <= _LEVEL_M:
            groups[-1].append(level)
        else:
            groups.append([level])
    return [group[0] for group in sorted(groups, key=lambda g: (-len(g), g[0]))]


def _grid(thing: SceneObject, receptacle: SceneObject) -> Floats:
    """Return the places to try, shape (n, 2): x and z."""
    sides = []
    for axis in (0, 2):
        room = max(receptacle.size[axis] - thing.size[axis] - 0.01, 0.0)
        count = min(int(room / _STEP_M) + 1, _MOST)
        middle = receptacle.center[axis]
        sides.append(
            np.array([middle]) if count == 1 else middle + np.linspace(-room / 2, room / 2, count)
        )
    across, along = np.meshgrid(*sides, indexing="ij")
    return np.stack([across.ravel(), along.ravel()], axis=1)


def _first_free(
    state: WorldState,
    thing: SceneObject,
    receptacle: SceneObject,
    places: Floats,
    level: float,
    attempt: _Try,
    barred: tuple[Floats, Floats],
) -> tuple[float, float] | None:
    """Return the first of some places, shape (n, 2), on which a thing can come to rest."""
    low, high = barred
    half = np.array(thing.size) / 2 * attempt.clearance
    level = resting(thing, level)
    tall = (level - half[1] < high[:, 1]) & (level + half[1] > low[:, 1])
    low, high = low[tall][:, [0, 2]] - half[[0, 2]], high[tall][:, [0, 2]] + half[[0, 2]]
    keep_off = attempt.standing and receptacle.type != FLOOR
    for start in range(0, len(places), _AT_ONCE):
        some = places[start : start + _AT_ONCE, None]
        taken = ((some < high) & (some > low)).all(axis=2).any(axis=1)
        for index in np.flatnonzero(~taken):
            x, z = places[start + index]
            if not (keep_off and state.room.stands(x, z)):
                return (float(x), float(z))
    return None


def _obstacles(
    state: WorldState, receptacle: SceneObject, *, strangers: bool
) -> tuple[Floats, Floats]:
    """Return the lower and upper corners of what may be in the way, each shape (n, 3).

    Real rooms list a worktop among a sink's contents: only what can be moved takes up room.
    """
    objects, in_hand = state.objects, state.in_hand
    ids = {o for o in objects.containment.inside(receptacle.id) if is_loose(objects[o])}
    low, high = solid_boxes(objects) if strangers else (objects.boxes.low, objects.boxes.high)
    if strangers:
        around = {receptacle.id, *objects.containment.around(receptacle.id)}
        mine = blocking(objects, [objects.rows[receptacle.id]])[0]
        ids |= {o for o, row in objects.rows.items() if mine[row] and o not in around}
    rows = [
        objects.rows[object_id]
        for object_id in ids
        if object_id not in in_hand and not is_inert(objects[object_id])
    ]
    return low[rows], high[rows]


def land(state: WorldState, thing: SceneObject, x: float, z: float) -> tuple[Vec3, str | None]:
    """Return where a falling thing's middle comes to rest, and the receptacle it lands in or on.

    It falls on the highest surface below it; on the floor where the agent can stand.
    """
    best, holder = state.room.floor_y, floor_id(state.objects)
    if not state.room.stands(x, z):
        for other in lying_below(state, x, z):
            for level in _surfaces(state, other):
                if best < level <= bottom(thing) + 0.05:
                    best, holder = level, _holds(state.objects, other, level)
    return (x, resting(thing, best), z), holder


def floor_id(objects: Objects) -> str | None:
    """Return the id of the floor, if it is an object."""
    return next(iter(objects.by_type.get(FLOOR, ())), None)


def lying_below(state: WorldState, x: float, z: float) -> list[SceneObject]:
    """Return what has a vertical line through its box, the floor apart; receptacles last."""
    objects = state.objects
    inside = boxes_round(objects, x, z) & ~inert_rows(objects)
    things = list(objects.values())
    found = [things[row] for row in np.flatnonzero(inside)]
    found = [one for one in found if one.type != FLOOR and one.id not in state.in_hand]
    return sorted(found, key=lambda one: "receptacle" in one.capabilities)


def _surfaces(state: WorldState, other: SceneObject) -> list[float]:
    """Return the heights at which an object stops what falls on it.

    The box of a bed or a desk reaches up to its headboard: where it holds things, they tell.
    """
    if "receptacle" not in other.capabilities or is_shut(other):
        return [top(other)]
    used = _in_use(state.objects, other)
    if used and other.type not in rules().put.open_top:
        return used
    return [bottom(other) if other.type in rules().put.inside else top(other)]


def _holds(objects: Objects, other: SceneObject, level: float) -> str | None:
    """Return the receptacle that what rests on an object lies in: the object, or one around it.

    What falls on a book on a table, or on a closed box, lies on what those lie on.
    """
    single = object_types()[other.type].accepts_only
    if "receptacle" in other.capabilities and not is_shut(other) and not single:
        return other.id
    low = level - bottom(other) <= rules().put.surface_reach_m
    return next(iter(other.parents), None) if low else None


def flight(room: Room, start: Vec3, step: tuple[float, float], far_m: float) -> tuple[float, float]:
    """Return (x, z) where a thrown thing comes down: straight on, above floor to stand on."""
    x, z = start[0], start[2]
    for _ in range(round(far_m / 0.05)):
        following = (x + step[0] * 0.05, z + step[1] * 0.05)
        if room.key(*following) not in room.cells:
            break
        x, z = following
    return (round(x, 5), round(z, 5))


# ----------------------------------------------------------------- what a thing lies in


def parents_in(objects: Objects, thing: SceneObject, holder: str) -> tuple[str, ...]:
    """Return the receptacles whose volume a thing is in, once it lies in one: the nearest first.

    AI2-THOR asks trigger volumes, and those of surfaces reach some way up: what lies in a plate on
    a counter lies on the counter too, and what lies in a bin on the floor lies on the floor.
    Furniture that stands on others is not passed through: a fork in a built-in sink is not on the
    worktop. How high the floor's volume reaches differs from room to room, see `floor_reach`.
    """
    place = objects[holder]
    found = [holder]
    for other in place.parents:
        if objects[other].type == FLOOR:
            if bottom(thing) <= floor_reach(objects, other):
                found.append(other)
        elif is_loose(place) and bottom(thing) - bottom(place) <= rules().put.surface_reach_m:
            found.append(other)
    return tuple(found)


def nested(objects: Objects, thing: SceneObject) -> SceneObject:
    """Return what lies in a thing just put down, lying also in what that thing lies in."""
    around = (p for own in thing.parents for p in parents_in(objects, thing, own))
    parents = tuple(dict.fromkeys((*thing.parents, *around)))
    return msgspec.structs.replace(thing, parents=parents)


def floor_reach(objects: Objects, floor: str) -> float:
    """Return the height up to which things in furniture lie on the floor as well, metres.

    It is read off the room: at least as high as the highest thing that lists the floor, lower
    than anything in furniture on the floor that does not; between the two, a usual height.
    """
    level = top(objects[floor])
    on_floor = frozenset(objects.containment.children.get(floor, ()))
    least = max((bottom(objects[child]) for child in on_floor), default=level)
    most = min(
        (
            bottom(thing)
            for thing in objects.values()
            if floor not in thing.parents and not on_floor.isdisjoint(thing.parents)
        ),
        default=float("inf"),
    )
    usual = max(level + rules().put.floor_reach_m, least + _INSIDE_M)
    return max(least, min(usual, most - _LEVEL_M))
