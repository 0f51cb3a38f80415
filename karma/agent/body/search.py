"""Looking for a thing whose place is not known: area by area, then in what can be opened."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from karma.agent.body.reach import Reach
from karma.agent.body.refusals import NOT_FOUND, RefusedError
from karma.agent.body.sightings import known, means
from karma.agent.body.walk import OutOfActionsError
from karma.agent.seeing.projection import before, spots
from karma.household.containment import goes_in
from karma.household.ids import type_of
from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.types.memory import Known
from karma.types.observation import SeenObject
from karma.types.space import Vec3

Place = TypeVar("Place")
_LEFT_TO_CLOSE = 30  # actions; with fewer nothing is opened that would be left standing open
_ALL_SEARCHED = "and all of this room was searched; do not search for it again"
_HORIZONS = (30.0, 0.0)  # tables and the floor, then shelves


class Search:
    """Looks for one thing by its name, or only looks round; counts the places it looked at.

    Where nothing is believed of the thing, `positions` are looked at first.
    """

    def __init__(self, reach: Reach, name: str = "", positions: Sequence[str | Vec3] = ()) -> None:
        self._reach, self._log, self._walker = reach, reach.log, reach.walker
        self._name, self._positions = name, positions

    def explore(self) -> Known:
        """Go to the thing where it is believed to be, opening what it is shut in, or look for it.

        Refuses what is nowhere.
        """
        passed: set[str] = set()  # a belief that proves wrong gives way to the next one
        while (target := self._reach.names.find(self._name)) and target.object_id not in passed:
            passed.add(target.object_id)
            with suppress(RefusedError):
                if not self._reach.approach(target, closed_will_do=True):
                    self._open_round(target)
                return target
        found = self._find()
        self._reach.used = []  # not the places searched on the way
        self._reach.use(found)
        return found

    def _open_round(self, target: Known) -> None:
        """Open the closed container that a thing is remembered in, and look for it there."""
        place = self._reach.shut_in(target)
        if place is not None:
            self._reach.act(known(place), "OpenObject")
            self._reach.explorations += 1
        self._reach.approach(target)

    def _find(self) -> Known:
        """Look for a thing until it is in view; every node and every opened container is counted.

        First the given positions, then the other areas, the nearest first (without areas: places
        that cover the room); then the containers that may hold such a thing, the closed ones first;
        then places between, from which corners come into reach of the eye; then what is left of the
        containers.

        Places that the log has as looked at, for this thing or another, are left out until
        something is done near them.

        Raises:
            RefusedError: it is nowhere.
        """
        found = self._in_view()
        in_vain = f"{NOT_FOUND} {self._name}, {_ALL_SEARCHED}"
        if found is None and self._is_searched():
            raise RefusedError(f"{NOT_FOUND} {self._name}; everything was searched before", in_vain)
        for place in self._places():
            if found is not None:
                return found
            if isinstance(place, SeenObject):
                look = self.look_into if self._may_open(place) else self._look_on
                found = look(place)
            else:
                found = self.look_from(place)
        if found is None:
            places = self._reach.explorations
            raise RefusedError(f"{NOT_FOUND} {self._name}; searched {places} places", in_vain)
        return found

    def _places(self) -> Iterator[Vec3 | SeenObject]:
        """Yield where to look next, until everything was looked at."""
        yield from self._nodes()
        yield from iter(lambda: self._next_container(only_likely=True), None)
        yield from self._nearest_next(self._cover(self._reach.limits.look_again_m))
        yield from iter(lambda: self._next_container(only_likely=False), None)
        yield from iter(self._next_surface, None)

    def _is_searched(self) -> bool:
        """Return whether the log leaves nothing to look at."""
        if not self._log.looked_from or self._next_container(only_likely=False):
            return False
        if self._next_surface():
            return False
        return not self._cover(self._reach.limits.look_again_m)

    def look_from(self, point: Vec3) -> Known | None:
        """Walk near a point and look around for a thing, counted as one place searched.

        A place that was looked at before, with nothing done near it since, is left out.
        """
        cell = self._walker.cell_near(point)
        if cell in self._log.looked_from:
            return None
        self._walker.walk_near(point)
        self._reach.explorations += 1
        found = self.look_around()
        if found is None:
            self._log.looked_from.add(cell)
        return found

    def _in_view(self) -> Known | None:
        sights = [sight for sight in self._log.in_view.values() if means(self._name, sight)]
        out = self._log.cut | self._log.aside
        sights = [sight for sight in sights if sight.object_id not in out]
        gap = self._walker.gap
        near = min(sights, key=lambda s: (gap(s.box_center_m), s.object_id), default=None)
        return known(near) if near else None

    def look_around(self) -> Known | None:
        """Turn round looking down at tables, then straight ahead; stop at the thing."""
        level = abs(self._walker.horizon_deg) < 1.0
        for horizon in _HORIZONS[::-1] if level else _HORIZONS:
            self._walker.look(horizon)
            for turn in range(4):
                self._reach.look()
                found = self._in_view() if self._name else None
                if found is not None:
                    return found
                if turn < 3 and not self._walker.follow(["RotateRight"]):
                    break
        return None

    def _nodes(self) -> Iterator[Vec3]:
        """Yield the points to search from: the given ones in order, then the nearest next."""
        areas = {area.name: area.position_m for area in self._reach.knowledge.areas()}
        for position in self._positions:
            if not isinstance(position, str):
                yield position
            elif position in areas:
                yield areas.pop(position)
            elif (place := self._reach.names.find(position)) is not None:
                yield place.position_m
        rest = list(areas.values())
        if not self._reach.knowledge.areas():
            rest = self._cover(self._reach.limits.cover_m)
        yield from self._nearest_next(rest)

    def _nearest_next(self, points: Iterable[Vec3]) -> Iterator[Vec3]:
        """Yield points, each time the one nearest to where the agent has come to."""
        return best_next(points, lambda point: (self._walker.gap(point), point))

    def _cover(self, within_m: float) -> list[Vec3]:
        """Return cells so that every cell is near one of them, or near one looked round from."""
        if self._log.looked_from:
            return cover(self._walker.cells(), self._log.looked_from, within_m)
        here = self._walker.position
        return [(here[0], 0.0, here[1]), *cover(self._walker.cells(), [here], within_m)]

    def _next_container(self, *, only_likely: bool) -> SeenObject | None:
        """Return the container to look into next: closed, that may hold the thing, and near."""
        types = object_types()
        wanted = types.get(type_of(self._name))
        if wanted is not None and not wanted.can("pickupable"):
            return None

        def rank(sight: SeenObject) -> tuple[bool, bool, float, str]:
            fits = wanted is not None and wanted.fits(types[sight.object_type])
            gap = self._walker.gap(sight.box_center_m)
            return "opened" in self._log.states(sight), not fits, gap, sight.object_id

        containers = [
            sight
            for object_id, sight in self._log.seen.items()
            if object_id not in self._log.looked_into
            if sight.object_type not in self._reach.kept_shut
            if (kind := types.get(sight.object_type)) and kind.can("receptacle")
            if not only_likely or wanted is None or wanted.fits(kind)
            if self._may_open(sight)
        ]
        return min(containers, key=rank, default=None)

    def _may_open(self, sight: SeenObject) -> bool:
        """Return whether a container has a door, by its states, else its type."""
        states = self._log.states(sight)
        has_door = object_types()[sight.object_type].can("openable")
        return bool({"closed", "opened"} & set(states)) if states else has_door

    def _next_surface(self) -> SeenObject | None:
        """Return the nearest furniture without doors, not looked at, that may hold a thing."""
        types = object_types()
        wanted = types.get(type_of(self._name))
        if wanted is None or not wanted.can("pickupable"):
            return None
        surfaces = [
            sight
            for object_id, sight in self._log.seen.items()
            if object_id not in self._log.looked_into and not sight.pickupable
            if sight.object_type in types and sight.object_type != FLOOR
            if goes_in(wanted.name, sight.object_type) and not self._may_open(sight)
        ]
        gap = self._walker.gap
        return min(surfaces, key=lambda s: (gap(s.box_center_m), s.object_id), default=None)

    def _look_on(self, surface: SeenObject) -> Known | None:
        """Look at all of a surface that was not in view before."""
        before = len(self._log.looks)
        found = self._look_over(surface, inside=False)
        if found is None:
            self._log.looked_into.add(surface.object_id)
        self._reach.explorations += len(self._log.looks) > before
        return found

    def look_over(self, place: SeenObject) -> str:
        """Look at all that is on a surface, or in a container, which is open then; no remark."""
        opens = self._may_open(place)
        if opens and "opened" not in self._log.states(place):
            self._reach.act(known(place), "OpenObject")
        elif opens:
            self._reach.approach(known(place))
        self._look_over(place, inside=opens)
        self._reach.explorations += 1
        return ""

    def look_into(self, container: SeenObject) -> Known | None:
        """Open a container and look; what was closed is closed again if the thing is not there."""
        if self._walker.max_actions - self._walker.actions < _LEFT_TO_CLOSE:
            raise OutOfActionsError
        target = known(container)
        shut = "opened" not in self._log.states(container)
        try:
            if shut:
                self._reach.act(target, "OpenObject", in_passing=True)
            else:
                self._reach.approach(target)
        except RefusedError:
            self._log.looked_into.add(container.object_id)
            return None
        self._reach.explorations += 1
        found = self._in_view()
        if found is None:
            found = self._look_over(container, inside=True, since=len(self._log.looks) - 1)
        if found is None:
            self._log.looked_into.add(container.object_id)
            if shut:
                with suppress(RefusedError):
                    self._reach.act(target, "CloseObject", in_passing=True)
        else:
            self._log.handled_ids += (container.object_id,)
            self._log.focus[container.object_type] = container.object_id
        return found

    def _look_over(self, space: SeenObject, *, inside: bool, since: int = 0) -> Known | None:
        """Look at what holds things until every point of it was in view that can be, or the thing.

        First one look whence nothing at all hides a point, then past what surely does; what is
        hidden from everywhere is looked for from near.

        Looks before `since` do not count: it was closed.
        """
        hidden = spots(space, inside=inside)
        for surely, most in ((False, int(inside)), (True, len(hidden))):
            points, tried, looks = hidden, set[Vec3](), len(self._log.looks)
            while len(self._log.looks) < looks + most:
                seen = self._log.seen.values()  # more with each look
                things = before(space, seen, inside=inside, surely=surely)
                hidden = self._reach.unseen(points, things, since=since)
                rest = [point for point in hidden if point not in tried]
                if not rest:
                    break
                tried.add(point := self._farthest(rest))
                if self._reach.look_at_point(point, things):
                    found = self._in_view()
                    if found is not None:
                        return found
        since = len(self._log.looks)
        while hidden:
            hidden.remove(point := self._farthest(hidden))
            if self._reach.look_at_point(point, [], nearest=True):
                found = self._in_view()
                if found is not None:
                    return found
                hidden = self._reach.unseen(hidden, [], since=since)
        return None

    def _farthest(self, points: Iterable[Vec3]) -> Vec3:
        return max(points, key=lambda point: (self._walker.gap(point), point))


def best_next(places: Iterable[Place], rank: Callable[[Place], Any]) -> Iterator[Place]:
    """Yield places to look at, each time the one that ranks lowest by then."""
    rest = list(places)
    while rest:
        rest.remove(best := min(rest, key=rank))
        yield best


def cover(
    cells: Iterable[tuple[float, float]], near: Iterable[tuple[float, float]], within_m: float
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
