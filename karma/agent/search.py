"""Looking for a thing whose place is not known: area by area, then in what can be opened."""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress

from karma.agent.reach import Reach, RefusedError
from karma.agent.sightings import known, means
from karma.agent.walk import OutOfActionsError
from karma.contracts import Known, SeenObject, Vec3
from karma.household.ids import type_of
from karma.household.types import object_types

_FAR_M = 0.85  # from so far away one looks into what was opened
_LEFT_TO_CLOSE = 30  # actions; with fewer nothing is opened that would be left standing open
_HORIZONS = (30.0, 0.0)  # tables and the floor, then shelves


def search(reach: Reach, name: str, positions: Sequence[str | Vec3]) -> Known:
    """Look for a thing until it is in view; every node and every opened container is counted.

    First the given positions, then the other areas, the nearest first (without areas: places that
    cover the room); then the containers that may hold such a thing, the closed ones first; then
    places between, from which what stands in a corner may come into reach of the eye; then what is
    left of the containers.

    Where the log has it that everything was looked at, for this thing or another, nothing is to be
    found that it does not know: such places are left out until something is done near them.

    Raises:
        RefusedError: it is nowhere.
    """
    found = _in_view(reach, name)
    if found is None and _is_searched(reach, name):
        raise RefusedError(f"could not find {name}; everything was searched before")
    for place in _places(reach, name, positions):
        if found is not None:
            return found
        if isinstance(place, SeenObject):
            found = look_into(reach, name, place)
        else:
            found = look_from(reach, name, place)
    if found is None:
        raise RefusedError(f"could not find {name}; searched {reach.explorations} places")
    return found


def _places(
    reach: Reach, name: str, positions: Sequence[str | Vec3]
) -> Iterator[Vec3 | SeenObject]:
    """Yield where to look next, until everything was looked at."""
    yield from _nodes(reach, positions)
    yield from _containers(reach, name, only_likely=True)
    yield from _cover(reach, reach.limits.look_again_m)
    yield from _containers(reach, name, only_likely=False)


def _is_searched(reach: Reach, name: str) -> bool:
    """Return whether the log leaves nothing to look at."""
    if not reach.log.looked_from or _next_container(reach, name, only_likely=False):
        return False
    return not _cover(reach, reach.limits.look_again_m)


def look_from(reach: Reach, name: str, point: Vec3) -> Known | None:
    """Walk near a point and look around for a thing; one place is counted as searched.

    Not if the log has it that everything was looked at from there.
    """
    cell = reach.walker.cell_near(point)
    if cell in reach.log.looked_from:
        return None
    reach.walker.walk_near(point)
    reach.explorations += 1
    found = look_around(reach, name)
    if found is None:
        reach.log.looked_from.add(cell)
    return found


def _in_view(reach: Reach, name: str) -> Known | None:
    sights = [sight for sight in reach.log.in_view.values() if means(name, sight)]
    sights = [sight for sight in sights if sight.object_id not in reach.log.cut]
    gap = reach.walker.gap
    near = min(sights, key=lambda s: (gap(s.box_center_m), s.object_id), default=None)
    return known(near, "seen") if near else None


def look_around(reach: Reach, name: str = "") -> Known | None:
    """Turn round once looking down at tables, and once straight ahead; stop at a thing named."""
    level = abs(reach.walker.horizon_deg) < 1.0
    for horizon in _HORIZONS[::-1] if level else _HORIZONS:
        reach.walker.look(horizon)
        for turn in range(4):
            reach.look()
            found = _in_view(reach, name) if name else None
            if found is not None:
                return found
            if turn < 3 and not reach.walker.turn_right():
                break
    return None


def _nodes(reach: Reach, positions: Sequence[str | Vec3]) -> Iterator[Vec3]:
    """Yield the points to search from: the given ones in order, then the rest, nearest first."""
    areas = {area.name: area.position_m for area in reach.knowledge.areas()}
    for position in positions:
        if not isinstance(position, str):
            yield position
        elif position in areas:
            yield areas.pop(position)
        elif (place := reach.find(position)) is not None:
            yield place.position_m
    rest = list(areas.values())
    if not reach.knowledge.areas():
        rest = _cover(reach, reach.limits.cover_m)
    while rest:
        rest.sort(key=lambda point: (reach.walker.gap(point), point))
        yield rest.pop(0)


def _cover(reach: Reach, within_m: float) -> list[Vec3]:
    """Return cells so that every cell is near one of them, or near one looked round from."""
    if reach.log.looked_from:
        return cover(reach.walker.cells(), reach.log.looked_from, within_m)
    here = reach.walker.position
    return [(here[0], 0.0, here[1]), *cover(reach.walker.cells(), [here], within_m)]


def cover(
    cells: Iterable[tuple[float, float]],
    near: Iterable[tuple[float, float]],
    within_m: float,
) -> list[Vec3]:
    """Return cells so that every cell (x, z) is near one of them, or near one of the others."""
    chosen: list[Vec3] = []
    near = sorted(near)
    gaps = {cell: min(math.dist(cell, point) for point in near) for cell in sorted(cells)}
    while max(gaps.values(), default=0.0) > within_m:
        x, z = max(gaps, key=lambda cell: (gaps[cell], cell))
        chosen.append((x, 0.0, z))
        gaps = {cell: min(gap, math.dist(cell, (x, z))) for cell, gap in gaps.items()}
    return chosen


def _containers(reach: Reach, name: str, *, only_likely: bool) -> Iterator[SeenObject]:
    """Yield the containers that were not looked into, while there are any."""
    while (container := _next_container(reach, name, only_likely=only_likely)) is not None:
        yield container


def _next_container(reach: Reach, name: str, *, only_likely: bool) -> SeenObject | None:
    """Return the container to look into next: closed, that may hold the thing, and near."""
    types = object_types()
    wanted = types.get(type_of(name))
    if wanted is not None and not wanted.can("pickupable"):
        return None

    def rank(sight: SeenObject) -> tuple[bool, bool, float, str]:
        fits = wanted is not None and wanted.fits(types[sight.object_type])
        gap = reach.walker.gap(sight.box_center_m)
        return "opened" in sight.states, not fits, gap, sight.object_id

    containers = [
        sight
        for object_id, sight in reach.log.seen.items()
        if object_id not in reach.log.looked_into and {"closed", "opened"} & set(sight.states)
        if (kind := types.get(sight.object_type)) and kind.can("receptacle")
        if not only_likely or wanted is None or wanted.fits(kind)
    ]
    return min(containers, key=rank, default=None)


def look_into(reach: Reach, name: str, container: SeenObject) -> Known | None:
    """Open a container and look; what was closed is closed again if the thing is not there."""
    if reach.walker.left < _LEFT_TO_CLOSE:
        raise OutOfActionsError
    target = known(container, "seen")
    shut = "closed" in container.states
    try:
        if shut:
            reach.act(target, "OpenObject", in_passing=True)
        else:
            reach.approach(target)
    except RefusedError:
        reach.log.looked_into.add(container.object_id)
        return None
    reach.explorations += 1
    found = _in_view(reach, name)
    if found is None:
        found = _look_inside(reach, name, container)
    if found is None:
        reach.log.looked_into.add(container.object_id)
        if shut:
            with suppress(RefusedError):
                reach.act(target, "CloseObject", in_passing=True)
    else:
        reach.log.handled.append(container.object_id)
        reach.log.focus[container.object_type] = container.object_id
    return found


def _look_inside(reach: Reach, name: str, container: SeenObject) -> Known | None:
    """Look into an open container from far, from another side, and past what stands in there."""
    target, tried = known(container, "seen"), [reach.walker.here()]
    for gap_m, aside in ((_FAR_M, False), (0.0, True)):
        past = container.box_center_m if aside else None
        if reach.next_view(target, tried, least_gap_m=gap_m, past=past):
            found = _in_view(reach, name)
            if found is not None:
                return found
    hides = _hiding(reach, name, container)
    if hides is not None:
        reach.next_view(target, tried, past=hides.box_center_m)
    return _in_view(reach, name)


def _hiding(reach: Reach, name: str, container: SeenObject) -> SeenObject | None:
    """Return the largest thing seen in a container, if it is larger than what is looked for."""
    kind = object_types().get(type_of(name))
    least = math.prod(kind.size_m) if kind is not None else 0.0
    inside = [
        one
        for one in reach.log.seen.values()
        if container.object_id in one.parent_ids and math.prod(one.box_size_m) > least
    ]
    return max(inside, key=lambda one: (math.prod(one.box_size_m), one.object_id), default=None)
