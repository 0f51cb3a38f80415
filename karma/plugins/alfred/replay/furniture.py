"""Place a room's fixed objects, with the ids that a trial uses and boxes from AI2-THOR 5.0.0.

Between the AI2-THOR that ALFRED was recorded on and 5.0.0, fixed objects were shifted, renamed,
moved or dropped. An id of ALFRED's takes, of what the dump has left:
1. the box of the nearest object of its type, where it stands; origins moved from a table's top to
   its foot, so heights may differ,
2. the box of a receptacle of another type that has the same origin: a renamed one,
3. the shape of an object of its type elsewhere in the room: a moved one,
4. the shape of its type in other rooms, or the typical one of `types.toml`, widened by what is
   known to have lain there.
What the dump has beyond that (windows, chairs, the floor) is there as it is. A sink or bathtub of
which only the basin is recorded is inferred from it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import msgspec

from karma.household.ids import is_part, made_at, root_id, root_type, type_of
from karma.household.places import FLOOR
from karma.household.types import object_types, type_now
from karma.household.uses import BASIN_OF, BASINS, FAUCET
from karma.household.water import POURS_M
from karma.plugins.alfred.replay.facts import LabelledSpot, RoomFacts
from karma.types.space import Vec3
from karma.world.core.boxes import Box
from karma.world.core.hiding import EDGE_M, WORKTOP, built_in
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.thing import bottom, box_of, difference, gaps, moved, top

_BESIDE_M = 0.35  # two versions of one object, across the floor
_ABOVE_M = 1.2  # and in height
_SAME_ORIGIN_M, _SAME_HEIGHT_M = 0.3, 0.15
_ORIGIN_OFF_M = 0.3  # from an object's box, at most
_ONE_M = 0.05  # two ids of one object
_MARGIN_M = 0.1  # round what lay on a surface
_ON_FLOOR_M = 0.15
_FOOT_M = 0.02
_STAND_M = 0.75  # from a cell to the front of furniture that is used from it
_RIM_M = 0.05  # of a sink or bathtub, round its basin


def furnished(facts: RoomFacts, floor_y: float, kinds: frozenset[str]) -> list[SceneObject]:
    """Return everything but what trials place themselves; the dump's own of `kinds` go."""
    places = {
        one: place
        for one, place in facts.fixed.items()
        if (kind := type_now(type_of(one))) and kind not in kinds
    }
    dump = [] if facts.dump is None else [*facts.dump.objects]
    rest = [o for o in dump if "pickupable" not in o.capabilities and o.type not in kinds]
    here, elsewhere = _matched(places, rest)
    found, ids, guessed = [], dict[str, str](), set[str]()
    for one, place in places.items():
        thing = here.get(one, elsewhere.get(one))
        if thing is None:
            guessed.add(one)
            found.append(_typical(one, place, facts, floor_y))
        else:
            ids.setdefault(thing.id, one)
            found.append((_same if one in here else _at)(thing, one, place))
    found += [o for o in rest if o.id not in ids and o.id not in places]
    found += _wholes(found, facts)
    found = [_fitted(thing, found, facts) if thing.id in guessed else thing for thing in found]
    found = _with_floor(found, facts, floor_y)
    return _related(found, ids)


# ----------------------------------------------------------------- matching


def _matched(
    places: Mapping[str, Vec3], things: Sequence[SceneObject]
) -> tuple[dict[str, SceneObject], dict[str, SceneObject]]:
    """Return what of the dump each id is: where it stands, and, of the rest, what was moved."""
    found: dict[str, SceneObject] = {}
    taken: set[str] = set()
    for pairs in (_of_one_kind(places, things), _of_one_origin(places, things)):
        _pair(sorted(pairs), things, found, taken)
    for _, one, index in sorted(_of_one_kind(places, things)):  # two ids of one object
        gap = math.dist(places[one], things[index].position)
        if one not in found and gap <= _ONE_M:
            found[one] = things[index]
    elsewhere = sorted(
        (math.dist(place, thing.position), one, index)
        for one, place in places.items()
        for index, thing in enumerate(things)
        if one not in found and thing.type == type_now(type_of(one))
    )
    strays: dict[str, SceneObject] = {}
    _pair(elsewhere, things, strays, taken)
    return found, strays


_Pair = tuple[float, str, int]  # how far, id, index of the dump's object


def _pair(
    pairs: Sequence[_Pair],
    things: Sequence[SceneObject],
    found: dict[str, SceneObject],
    taken: set[str],
) -> None:
    """Match the nearest pairs first, each side once."""
    for _, one, index in pairs:
        thing = things[index]
        if one not in found and thing.id not in taken:
            found[one] = thing
            taken.add(thing.id)


def _of_one_kind(places: Mapping[str, Vec3], things: Sequence[SceneObject]) -> Iterator[_Pair]:
    for one, place in places.items():
        kind = type_now(type_of(one))
        for index, thing in enumerate(things):
            if thing.type != kind:
                continue
            across, up = _gaps(place, _origin(one, thing))
            if across <= _BESIDE_M and up <= _ABOVE_M:
                yield across + up, one, index
            elif not _origin_at_box(thing) and math.dist(place, thing.center) <= _BESIDE_M:
                yield math.dist(place, thing.center), one, index


def _of_one_origin(places: Mapping[str, Vec3], things: Sequence[SceneObject]) -> Iterator[_Pair]:
    for one, place in places.items():
        if "receptacle" not in object_types()[type_now(type_of(one)) or ""].capabilities:
            continue
        for index, thing in enumerate(things):
            if thing.type == FLOOR or "receptacle" not in thing.capabilities:
                continue
            across, up = _gaps(place, thing.position)
            if across <= _SAME_ORIGIN_M and up <= _SAME_HEIGHT_M:
                yield across + up, one, index


def _origin(one: str, thing: SceneObject) -> Vec3:
    """Return a dump object's place, measured as the id's is: basins by their sink or tub."""
    basin = one.count("|") == 4
    return (made_at(thing.id) if basin else None) or thing.position


def _origin_at_box(thing: SceneObject) -> bool:
    """Return whether an object's origin is at its box; a few have theirs at the room's."""
    return all(
        abs(thing.position[axis] - thing.center[axis]) <= thing.size[axis] / 2 + _ORIGIN_OFF_M
        for axis in range(3)
    )


def _gaps(a: Vec3, b: Vec3) -> tuple[float, float]:
    return math.hypot(a[0] - b[0], a[2] - b[2]), abs(a[1] - b[1])


# ----------------------------------------------------------------- making


def _same(thing: SceneObject, one: str, place: Vec3) -> SceneObject:
    """Return the dump's object under ALFRED's id; its box follows its origin across the floor."""
    x, y, z = thing.position
    if one.count("|") == 4 or not _origin_at_box(thing):
        return _renamed(thing, one, thing.position if one.count("|") == 4 else place)
    up = place[1] - y if abs(place[1] - y) <= _SAME_HEIGHT_M else 0.0
    return _renamed(moved(thing, (place[0] - x, up, place[2] - z)), one, place)


def _at(thing: SceneObject, one: str, place: Vec3) -> SceneObject:
    """Return a dump's object, brought to where ALFRED has it."""
    origin = thing.position if _origin_at_box(thing) else thing.center
    return _renamed(moved(thing, difference(place, origin)), one, place)


def _renamed(thing: SceneObject, one: str, place: Vec3) -> SceneObject:
    kind = type_now(type_of(one)) or thing.type
    same = kind == thing.type
    return msgspec.structs.replace(
        thing,
        id=one,
        type=kind,
        name=one,
        position=place,
        capabilities=thing.capabilities if same else object_types()[kind].capabilities,
        openness=0.0,
    )


def _typical(one: str, place: Vec3, facts: RoomFacts, floor_y: float) -> SceneObject:
    """Return an object that no dump of the room has: its type's shape, and what lay there."""
    kind = type_now(type_of(one)) or ""
    row, model = object_types()[kind], facts.models.get(kind)
    size = row.size_m if model is None else model.size
    if model is None:
        low = place[1] if place[1] <= floor_y + _ON_FLOOR_M else place[1] - size[1] / 2
    else:
        low = bottom(model) + place[1] - model.position[1]
    low = max(low, floor_y)
    made = SceneObject(
        id=one,
        type=kind,
        name=one,
        position=place,
        center=(place[0], low + size[1] / 2, place[2]),
        size=size,
        capabilities=row.capabilities,
        mass_kg=row.mass_kg,
        materials=row.materials,
    )
    return _round(made, [spot for spot in facts.spots if spot.receptacle == one])


def _fitted(thing: SceneObject, things: Sequence[SceneObject], facts: RoomFacts) -> SceneObject:
    """Return an object whose box is typical, cut to what stands round it."""
    if thing.type == FAUCET:
        return _down_to_basin(thing, things)
    return _to_fronts(thing, things, facts) if thing.type == WORKTOP else thing


def _down_to_basin(tap: SceneObject, things: Sequence[SceneObject]) -> SceneObject:
    """Return a tap that reaches down to the basin it pours into.

    Where its origin is on it, at its foot or its handle, differs from room to room.
    """
    x, _, z = tap.position
    far = [(math.hypot(*gaps(one, x, z)), top(one)) for one in things if one.type in BASINS]
    gap, low = min(far, default=(math.inf, 0.0))
    if gap > POURS_M or low >= bottom(tap):
        return tap
    return _boxed(tap, box_of(tap)._replace(y0=low))


def _to_fronts(thing: SceneObject, things: Sequence[SceneObject], facts: RoomFacts) -> SceneObject:
    """Return a worktop that ends at the fronts of what is built in beneath it, where one stands."""
    own = box_of(thing)
    beneath, sides = built_in(own, things), own._asdict()
    for low, high, across in (("x0", "x1", ("z0", "z1")), ("z0", "z1", ("x0", "x1"))):
        for side, sign, first in ((low, 1.0, min), (high, -1.0, max)):
            front = first((getattr(box, side) for box in beneath), default=sides[side])
            if any(
                0.0 < sign * (front - at) <= _STAND_M and sides[across[0]] < off < sides[across[1]]
                for at, off in (cell if low == "x0" else cell[::-1] for cell in facts.cells)
            ):
                sides[side] = sign * max(sign * sides[side], sign * front - EDGE_M)
    return _boxed(thing, Box(**sides))


def _boxed(thing: SceneObject, box: Box) -> SceneObject:
    return msgspec.structs.replace(thing, center=box.center, size=box.size)


def _wholes(things: Sequence[SceneObject], facts: RoomFacts) -> Iterator[SceneObject]:
    """Yield the sinks and bathtubs whose basins tell of them, by their ids, and nothing else does.

    Each is a rim round its basin, which takes what is put there. Where the room's types are known,
    they have to list it.
    """
    for basin in things:
        whole = root_id(basin.id)
        kind, place = root_type(whole), made_at(whole)
        if basin.type not in BASINS or not is_part(basin.id, of=whole) or place is None:
            continue
        ground = box_of(basin).grown(_RIM_M, 0.0, _RIM_M)
        alike = [box_of(one) for one in things if one.type == kind]
        seen = any(ground.overlaps(one._replace(y0=ground.y0, y1=ground.y1)) for one in alike)
        if seen or kind not in (facts.types or BASIN_OF):
            continue
        yield SceneObject(
            id=whole, type=kind, name=whole, position=place, center=ground.center,
            size=ground.size, inferred=True,
        )  # fmt: skip


def _round(thing: SceneObject, spots: Sequence[LabelledSpot]) -> SceneObject:
    """Widen a box to hold what lay there; a surface is as high as what lay on it."""
    if not spots:
        return thing
    low = [c - s / 2 for c, s in zip(thing.center, thing.size, strict=True)]
    high = [c + s / 2 for c, s in zip(thing.center, thing.size, strict=True)]
    for spot in spots:
        for axis, value in ((0, spot.x), (2, spot.z)):
            low[axis] = min(low[axis], value - _MARGIN_M)
            high[axis] = max(high[axis], value + _MARGIN_M)
    heights = sorted(spot.y for spot in spots)
    if thing.type in rules().put.inside:
        low[1], high[1] = min(low[1], heights[0]), max(high[1], heights[-1] + _MARGIN_M)
    else:
        high[1] = heights[len(heights) // 2]
        low[1] = min(low[1], high[1] - 0.02)
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    sides = tuple(b - a for a, b in zip(low, high, strict=True))
    return msgspec.structs.replace(thing, center=middle, size=sides)


def _with_floor(things: list[SceneObject], facts: RoomFacts, floor_y: float) -> list[SceneObject]:
    """Return the objects with a floor among them: all rooms of AI2-THOR 5.0.0 have one."""
    if any(thing.type == FLOOR for thing in things):
        return things
    xs, zs = [x for x, _ in facts.cells] or [0.0], [z for _, z in facts.cells] or [0.0]
    middle = ((min(xs) + max(xs)) / 2, floor_y - 0.05, (min(zs) + max(zs)) / 2)
    size = (max(xs) - min(xs) + 2.0, 0.1, max(zs) - min(zs) + 2.0)
    row = object_types()[FLOOR]
    floor = SceneObject(
        id=f"{FLOOR}|+00.00|+00.00|+00.00", type=FLOOR, name=FLOOR, position=(0.0, floor_y, 0.0),
        center=middle, size=size, capabilities=row.capabilities,
    )  # fmt: skip
    return [*things, floor]


def _related(things: Sequence[SceneObject], ids: Mapping[str, str]) -> list[SceneObject]:
    """Return the objects with the dump's relations under the new ids, as far as they hold."""
    by_id = {thing.id: thing for thing in things}
    found = []
    for thing in things:
        parents = [ids.get(parent, parent) for parent in thing.parents]
        holds = [p for p in dict.fromkeys(parents) if p in by_id and _may_hold(by_id[p], thing)]
        holds += [one.id for one in things if one.id not in holds and _stands_in(thing, one)]
        controls = [ids.get(other, other) for other in thing.controls]
        found.append(
            msgspec.structs.replace(
                thing,
                parents=tuple(holds),
                controls=tuple(c for c in controls if c in by_id),
            )
        )
    return found


def _stands_in(thing: SceneObject, place: SceneObject) -> bool:
    """Return whether a lamp, a plant and the like has its foot in a receptacle's box."""
    if "moveable" not in thing.capabilities or "receptacle" in thing.capabilities:
        return False
    shuts = place.type == FLOOR or place.type in rules().view.hides_when_closed
    if shuts or "receptacle" not in place.capabilities:
        return False
    foot = (thing.center[0], bottom(thing) + _FOOT_M, thing.center[2])
    return all(
        abs(foot[axis] - place.center[axis]) <= place.size[axis] / 2 + _FOOT_M for axis in range(3)
    )


def _may_hold(parent: SceneObject, thing: SceneObject) -> bool:
    """Return whether a thing is still within a receptacle's box, seen from above."""
    if parent.id == thing.id or math.prod(parent.size) <= math.prod(thing.size):
        return False
    low, high = bottom(parent) - 0.1, top(parent) + 0.3
    near = all(
        abs(parent.center[axis] - thing.center[axis]) <= parent.size[axis] / 2 for axis in (0, 2)
    )
    return near and low <= bottom(thing) <= high
