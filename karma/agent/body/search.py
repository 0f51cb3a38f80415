"""Looking for a thing whose place is not known: area by area, then in what can be opened."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from karma.agent.body.reach import Reach
from karma.agent.body.refusals import NOT_FOUND, RefusedError
from karma.agent.body.sightings import known, means
from karma.agent.body.walk import OutOfActionsError
from karma.agent.seeing.projection import before, spots, unseen
from karma.household.containment import goes_in
from karma.household.ids import type_of
from karma.household.places import FLOOR
from karma.household.types import object_types, types_with
from karma.types.memory import Known
from karma.types.observation import SeenObject
from karma.types.space import Vec3

Place = TypeVar("Place")
_LEFT_TO_CLOSE = 30  # actions; with fewer nothing is opened that would be left standing open
_ALL_SEARCHED = "and all of this room was searched; do not search for it again"
_HORIZONS = (30.0, 0.0)  # tables and the floor, then shelves


class Search:
    """A search for one object by its name, or only a look around; counts the places searched.

    If nothing is believed of the object, `positions` are searched first.
    """

    def __init__(self, reach: Reach, name: str = "", positions: Sequence[str | Vec3] = ()) -> None:
        self._reach, self._log, self._walker = reach, reach.log, reach.walker
        self._name, self._positions = name, positions

    def explore(self) -> Known:
        """Go to the object where it is believed to be, opening its container, or search for it.

        Raises:
            RefusedError: it is nowhere.
        """
        reach, passed = self._reach, set[str]()  # a belief that proves wrong yields to the next
        while (target := reach.names.find(self._name)) and target.object_id not in passed:
            passed.add(target.object_id)
            with suppress(RefusedError):
                if not reach.approach(target, closed_will_do=True):
                    if (place := reach.shut_in(target)) is not None:
                        reach.act(known(place), "OpenObject")
                        reach.explorations += 1
                    reach.approach(target)
                return target
        found = self._find()
        reach.used = []  # not the places searched on the way
        reach.use(found)
        return found

    def _find(self) -> Known:
        """Search until the object is in view; every node and every opened container is counted.

        Places that the log has as searched, for this object or another, are left out until
        something is done near them.

        Raises:
            RefusedError: it is nowhere.
        """
        found = self._in_view()
        unsuccessful = f"{NOT_FOUND} {self._name}"
        detail = f"{unsuccessful}, {_ALL_SEARCHED}"
        if found is None and self._log.looked_from:
            left = self._next(only_likely=False) or self._next(surfaces=True)
            if not left and not self._cover(self._reach.limits.look_again_m):
                raise RefusedError(f"{unsuccessful}; everything was searched before", detail)
        for place in self._places():
            if found is not None:
                return found
            if not isinstance(place, SeenObject):
                found = self.look_from(place)
            elif self._may_open(place):
                found = self.look_into(place)
            else:
                before = len(self._log.looks)
                found = self._look_over(place, inside=False)
                self._reach.explorations += len(self._log.looks) > before
                if found is None:
                    self._log.looked_into.add(place.object_id)
        if found is None:
            count = self._reach.explorations
            raise RefusedError(f"{unsuccessful}; searched {count} places", detail)
        return found

    def _places(self) -> Iterator[Vec3 | SeenObject]:
        """Yield where to look next, until everything was searched.

        First the given positions, then the other areas, the nearest first (without areas: cells
        that cover the room); then the containers that may hold such an object, the closed ones
        first; then cells between, from which corners come into view; then the other containers,
        and what of surfaces was not in view.
        """
        limits = self._reach.limits
        areas = {area.name: area.position_m for area in self._reach.knowledge.areas()}
        is_mapped, gap = bool(areas), self._walker.gap

        def by_gap(point: Vec3) -> tuple[float, Vec3]:
            return gap(point), point

        for position in self._positions:
            if not isinstance(position, str):
                yield position
            elif position in areas:
                yield areas.pop(position)
            elif (place := self._reach.names.find(position)) is not None:
                yield place.position_m
        rest = list(areas.values()) if is_mapped else self._cover(limits.cover_m)
        yield from best_next(rest, by_gap)
        yield from iter(lambda: self._next(only_likely=True), None)
        yield from best_next(self._cover(limits.look_again_m), by_gap)
        yield from iter(lambda: self._next(only_likely=False), None)
        yield from iter(lambda: self._next(surfaces=True), None)

    def look_from(self, point: Vec3) -> Known | None:
        """Walk near a point and look around, counted as one place searched.

        A place that was searched before, with nothing done near it since, is left out.
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
        out, gap = self._log.cut | self._log.aside, self._walker.gap
        sights = [
            sight
            for name, sight in self._log.in_view.items()
            if name not in out and means(self._name, sight)
        ]
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

    def _cover(self, within_m: float) -> list[Vec3]:
        """Return cells so that every cell is near one of them, or near one looked round from."""
        if self._log.looked_from:
            return cover(self._walker.cells(), self._log.looked_from, within_m)
        here = self._walker.position
        return [(here[0], 0.0, here[1]), *cover(self._walker.cells(), [here], within_m)]

    def _next(self, *, surfaces: bool = False, only_likely: bool = False) -> SeenObject | None:
        """Return the nearest container, or surface, that was not searched and may hold the object.

        Closed containers come before open ones, those that the object fits before others.
        """
        types, log = object_types(), self._log
        wanted = types.get(type_of(self._name))
        if surfaces if wanted is None else not wanted.can("pickupable"):
            return None
        ranked = []
        for name, sight in log.seen.items():
            kind = types.get(sight.object_type)
            if name in log.looked_into or kind is None or self._may_open(sight) == surfaces:
                continue
            gap = self._walker.gap(sight.box_center_m)
            if surfaces:
                is_fixed = not sight.pickupable and kind.name != FLOOR
                if wanted is not None and is_fixed and goes_in(wanted.name, kind.name):
                    ranked.append((False, False, gap, name))
            elif kind.can("receptacle") and kind.name not in self._reach.kept_shut:
                fits = wanted is not None and wanted.fits(kind)
                if fits or wanted is None or not only_likely:
                    ranked.append(("opened" in log.states(sight), not fits, gap, name))
        return log.seen[min(ranked)[-1]] if ranked else None

    def _may_open(self, sight: SeenObject) -> bool:
        """Return whether a container has a door, by its states, else its type."""
        states = self._log.states(sight)
        if states:
            return not {"closed", "opened"}.isdisjoint(states)
        return sight.object_type in types_with("openable")

    def look_over(self, place: SeenObject) -> str:
        """Look at the whole of a surface or container, which is open then; no remark."""
        opens = self._may_open(place)
        if opens and "opened" not in self._log.states(place):
            self._reach.act(known(place), "OpenObject")
        elif opens:
            self._reach.approach(known(place))
        self._look_over(place, inside=opens)
        self._reach.explorations += 1
        return ""

    def look_into(self, container: SeenObject) -> Known | None:
        """Open a container and look; if the object is not there, close what was closed."""
        if self._walker.max_actions - self._walker.actions < _LEFT_TO_CLOSE:
            raise OutOfActionsError
        log, target = self._log, known(container)
        shut = "opened" not in log.states(container)
        try:
            if shut:
                self._reach.act(target, "OpenObject", in_passing=True)
            else:
                self._reach.approach(target)
        except RefusedError:
            log.looked_into.add(container.object_id)
            return None
        self._reach.explorations += 1
        found = self._in_view()
        if found is None:
            found = self._look_over(container, inside=True, since=len(log.looks) - 1)
        if found is not None:
            log.handled_ids += (container.object_id,)
            log.focus[container.object_type] = container.object_id
            return found
        log.looked_into.add(container.object_id)
        if shut:
            with suppress(RefusedError):
                self._reach.act(target, "CloseObject", in_passing=True)
        return None

    def _look_over(self, space: SeenObject, *, inside: bool, since: int = 0) -> Known | None:
        """Look until the object, or every point of a receptacle that can be, was in view.

        First one look from where nothing at all hides a point, then past what surely does; last,
        from near, at points that are hidden from everywhere. Looks before `since` do not count.
        """
        log, reach_m = self._log, self._reach.limits.reach_m
        hidden = spots(space, inside=inside)
        for surely, most in ((False, int(inside)), (True, len(hidden))):
            points, tried, looks = hidden, set[Vec3](), len(log.looks)
            while len(log.looks) < looks + most:
                seen = log.seen.values()  # more with each look
                things = before(space, seen, inside=inside, surely=surely)
                hidden = unseen(points, log.looks[since:], things, reach_m=reach_m)
                rest = [point for point in hidden if point not in tried]
                if not rest:
                    break
                tried.add(point := self._farthest(rest))
                if self._reach.look_at_point(point, things):
                    found = self._in_view()
                    if found is not None:
                        return found
        since = len(log.looks)
        while hidden:
            hidden.remove(point := self._farthest(hidden))
            if self._reach.look_at_point(point, [], nearest=True):
                found = self._in_view()
                if found is not None:
                    return found
                hidden = unseen(hidden, log.looks[since:], [], reach_m=reach_m)
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
