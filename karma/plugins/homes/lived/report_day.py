"""A day of a home as the page's script reads it: who and what is where, centimetres and seconds."""

from collections.abc import Iterator, Sequence
from typing import Any

from karma.contracts import Vec3
from karma.household.ids import type_of
from karma.household.places import HAND
from karma.plugins.homes.houses import room_at
from karma.plugins.homes.lived.request import DAY_S, LivedRequest
from karma.plugins.homes.lived.trace import ROBOT, HomeTrace, TracedDeed, TracedRequest, TracedThing
from karma.plugins.homes.types import Deed, Fact, HomeAnswer, Sighting
from karma.world.core.navigate import corners, nearest_cell, path
from karma.world.core.state import Cell, Settings, WorldState, begin

WALK_S = 20.0  # before a deed, in which the page lets a resident walk there
WEEKDAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
VERBS = {
    "PickupObject": "takes", "PutObject": "puts", "OpenObject": "opens", "CloseObject": "closes",
    "CleanObject": "washes", "DirtyObject": "uses", "DropHandObject": "drops",
    "ToggleObjectOn": "switches on", "ToggleObjectOff": "switches off", "SliceObject": "slices",
    "FillObjectWithLiquid": "fills", "EmptyLiquidFromObject": "empties",
}  # fmt: skip
LEADS = {"PickupObject": "from", "PutObject": "at"}


def told_day(trace: HomeTrace, day: int) -> dict[str, Any]:
    """Return one day as the script reads it."""
    start, end = day * DAY_S, (day + 1) * DAY_S
    ways = _Ways(trace)
    deeds = [one for one in trace.deeds if start <= one.deed.time_s < end]
    return {
        "start": start,
        "end": end,
        "name": day_name(day),
        "things": list(_told_things(trace.things, start, end)),
        "people": list(_told_people(trace, ways, day)),
        "robot": _told_robot(trace, ways, start, end),
        "looks": [
            [one.time_s, one.seen, one.looked_over]
            for one in trace.looks
            if start <= one.time_s < end
        ],
        "deeds": [
            [one.deed.time_s, one.deed.who, deed_words(one.deed), one.deed.room] for one in deeds
        ],
        "requests": [_told_request(trace, one) for one in requests_of(trace, day)],
        "places": {
            one.id: [one.type, trace.places[one.id].room, *_cm(one.center)]
            for one in trace.scene.objects
            if one.id in trace.places
        },
    }


def requests_of(trace: HomeTrace, day: int) -> list[TracedRequest]:
    """Return the requests of a day."""
    return [one for one in trace.requests if one.request.time_s // DAY_S == day]


def day_name(day: int) -> str:
    """Return a day's name.

    >>> day_name(8)
    'Tue, day 8'
    """
    return f"{WEEKDAYS[day % 7]}, day {day}"


def clock(time_s: float) -> str:
    """Return a time of the home's clock.

    >>> clock(100_000.0)
    'Tue 03:46'
    """
    minutes = int(time_s // 60)
    return f"{WEEKDAYS[int(time_s // DAY_S) % 7]} {minutes // 60 % 24:02d}:{minutes % 60:02d}"


# ----------------------------------------------------------------- words


def deed_words(deed: Deed) -> str:
    """Return what somebody does, without who."""
    words = f"{VERBS.get(deed.action, deed.action)} {deed.object_type}"
    place = type_of(deed.place_id) if deed.place_id else ""
    if place and place != deed.object_type and deed.action in LEADS:
        words += f" {LEADS[deed.action]} {place}"
    return f"{words} ({deed.activity})" if deed.activity else words


def answer_words(trace: HomeTrace, request: LivedRequest, answer: HomeAnswer) -> str:
    """Return what the robot said or did."""
    errand = request.asked == "errand"
    if answer.unread:
        return f"does not know what {answer.unread[0]!r} means"
    if answer.unknown:
        return "gave up" if errand else "does not know"
    if answer.count is not None:
        return str(answer.count)
    if answer.who:
        return answer.who
    if answer.time_s is not None:
        return clock(answer.time_s)
    where = place_words(trace, answer.place_id, answer.room)
    states = f", {', '.join(answer.states)}" if answer.states and request.asked == "state" else ""
    return ("brought it to " if errand else "") + where + states


def right_words(trace: HomeTrace, request: LivedRequest) -> str:
    """Return what would have been right."""
    if request.unknown:
        return "there is none"
    if request.asked == "errand":
        return "to " + _either(trace, request.destinations)
    if request.count is not None:
        return str(request.count)
    if request.who:
        return request.who
    if request.asked == "time" and request.after_s is not None and request.before_s is not None:
        return f"{clock(request.after_s)} to {clock(request.before_s)}"
    return _either(trace, request.places) if request.places else request.room


def _either(trace: HomeTrace, place_ids: Sequence[str]) -> str:
    """Return places, those of one type and room once."""
    return " or ".join(dict.fromkeys(place_words(trace, one) for one in place_ids))


def place_words(trace: HomeTrace, place_id: str | None, room: str = "") -> str:
    """Return a place in words."""
    if place_id == HAND:
        return "somebody's hand"
    place = trace.places.get(place_id or "")
    if place is None:
        return f"the floor, {room}" if room else "the floor"
    return f"{place.place_type}, {place.room}"


# ----------------------------------------------------------------- parts


def _told_request(trace: HomeTrace, one: TracedRequest) -> dict[str, Any]:
    request, served = one.request, one.served
    return {
        "at": request.time_s,
        "over": one.over_s,
        "speaker": request.speaker,
        "text": request.text,
        "kind": request.kind,
        "right": served.right,
        "answer": answer_words(trace, request, one.answer),
        "wanted": right_words(trace, request),
        "believed": [_told_fact(trace, fact) for fact in one.went_by],
        "truth": [_told_sighting(trace, seen) for seen in one.truth],
        "effort": f"{served.actions} world actions, {served.places} places looked at, "
        f"{served.stale} of them on a belief that was false",
    }


def _told_fact(trace: HomeTrace, fact: Fact) -> dict[str, Any]:
    told = _told_sighting(trace, fact.sighting)
    sure = "" if fact.holds is None else f", holds with {fact.holds:.2f}"
    return told | {"seen": f"seen {clock(fact.sighting.time_s)}{sure}"}


def _told_sighting(trace: HomeTrace, seen: Sighting) -> dict[str, Any]:
    return {
        "id": seen.object_id,
        "type": seen.object_type,
        "place": seen.place_id,
        "where": place_words(trace, seen.place_id, seen.room),
        "at": _cm(seen.position_m),
    }


def _told_things(
    things: Sequence[TracedThing], start: float, end: float
) -> Iterator[dict[str, Any]]:
    """Yield each thing that is there on the day, with where it is from which time on."""
    by_id: dict[str, list[TracedThing]] = {}
    for one in things:
        if one.time_s < end:
            by_id.setdefault(one.object_id, []).append(one)
    for object_id, mine in by_id.items():
        before = [one for one in mine if one.time_s <= start]
        found = [*before[-1:], *(one for one in mine if one.time_s > start)]
        if found[-1].center_m is not None or found[-1].holder or len(found) > 1:
            yield {
                "id": object_id,
                "type": mine[0].object_type,
                "at": [
                    [one.time_s, *(_cm(one.center_m) if one.center_m else (None, None)), one.holder]
                    for one in found
                ],
            }


def _told_people(trace: HomeTrace, ways: "_Ways", day: int) -> Iterator[dict[str, Any]]:
    """Yield each resident: when up and away, and the walks between deeds."""
    start, end = day * DAY_S, (day + 1) * DAY_S
    for one in trace.residents:
        mine = [deed for deed in trace.deeds if deed.deed.who == one.name]
        before = [deed for deed in mine if deed.deed.time_s < start]
        at = ways.cell_at(before[-1].at_m) if before else ways.cell_in(trace.rooms[one.name])
        today = [deed for deed in mine if start <= deed.deed.time_s < end]
        yield {
            "name": one.name,
            "wakes": start + one.wake_h * 3600,
            "sleeps": start + one.sleep_h * 3600,
            "away": [start + hour * 3600 for hour in one.away_h[day % 7] or ()],
            "room": before[-1].deed.room if before else trace.rooms[one.name],
            "first": ways.point(at),
            "walks": list(_walks_between(ways, at, start, today)),
        }


def _walks_between(
    ways: "_Ways", at: Cell, time_s: float, deeds: Sequence[TracedDeed]
) -> Iterator[list[Any]]:
    for one in deeds:
        there, over_s = ways.cell_at(one.at_m), one.deed.time_s
        if there != at:
            yield [max(time_s, over_s - WALK_S), over_s, ways.way(at, there), one.deed.room]
        at, time_s = there, over_s


def _told_robot(trace: HomeTrace, ways: "_Ways", start: float, end: float) -> dict[str, Any]:
    before = [one for one in trace.walks if one.begun_s < start]
    pose = before[-1].end if before else trace.start
    return {
        "name": ROBOT,
        "first": [*_cm(pose.position_m), pose.yaw_deg],
        "room": ways.room_at(pose.position_m),
        "walks": [
            [
                one.begun_s,
                one.over_s,
                ways.way(ways.cell_at(one.start.position_m), ways.cell_at(one.end.position_m)),
                one.end.yaw_deg,
                ways.room_at(one.end.position_m),
            ]
            for one in trace.walks
            if start <= one.begun_s < end
        ],
    }


class _Ways:
    """Shortest ways over the cells of a home."""

    def __init__(self, trace: HomeTrace) -> None:
        self._scene = trace.scene
        self._state: WorldState = begin(trace.scene, Settings(grid_m=trace.scene.grid_m))
        self._rooms = {room.name: room for room in trace.scene.rooms or ()}
        self._known: dict[tuple[Cell, Cell], list[list[float]]] = {}

    def cell_at(self, place_m: Vec3) -> Cell:
        """Return the cell that somebody stands on at a place."""
        cell = nearest_cell(self._state, place_m[0], place_m[2])
        assert cell is not None
        return cell

    def cell_in(self, room: str) -> Cell:
        """Return a cell in the middle of a room."""
        if room not in self._rooms:
            return self.cell_at(self._scene.agent.position)
        where = self._rooms[room].corners
        return self.cell_at(
            (
                sum(x for x, _ in where) / len(where), 0.0, sum(z for _, z in where) / len(where)
            )
        )  # fmt: skip

    def room_at(self, place_m: Vec3) -> str:
        """Return the room that a place is in."""
        room = room_at(self._scene, place_m[0], place_m[2])
        return room.name if room is not None else self._scene.name

    def point(self, cell: Cell) -> list[float]:
        """Return where a cell is."""
        x, z = self._state.cells[cell]
        return _cm((x, 0.0, z))

    def way(self, start: Cell, end: Cell) -> list[list[float]]:
        """Return the turning points of a way."""
        if (start, end) not in self._known:
            cells = path(self._state.cells, start, end) or [start, end]
            self._known[start, end] = [self.point(cell) for cell in corners(cells)]
        return self._known[start, end]


def _cm(place_m: Vec3) -> list[float]:
    """Return x and y on the page."""
    return [round(place_m[0] * 100, 1) + 0.0, round(-place_m[2] * 100, 1) + 0.0]
