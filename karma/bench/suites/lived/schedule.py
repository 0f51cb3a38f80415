"""What a day of the robot looks like: rounds, waits and requests, the same for every row."""

from dataclasses import dataclass
from typing import get_args

from karma.bench.suites.lived.request import LivedKind
from karma.seeds import stream

DAY_S = 86_400.0
HOUR_S = 3_600.0
MOST_PEOPLE = 4
ROUNDS_H = (9.0, 17.5)  # when the robot walks through all rooms
REQUESTS_H = (9.75, 21.75)  # within which it is asked
KINDS: tuple[LivedKind, ...] = get_args(LivedKind)


@dataclass(frozen=True, slots=True, kw_only=True)
class DayItem:
    """Something that the robot is to do at a time."""

    time_s: float
    what: str  # "round", "wait" or "request"
    kind: LivedKind | None = None  # of a request
    room: str = ""  # to wait in


def drawn_people(seed: int, home: int, rooms: int) -> int:
    """Return how many people live in a home: small homes have fewer."""
    most = min(MOST_PEOPLE, 1 + rooms // 2)
    return int(stream(seed, "lived", "people", str(home)).integers(1, most + 1))


def day_plan(
    seed: int, home: int, day: int, rooms: tuple[str, ...], requests: int
) -> tuple[DayItem, ...]:
    """Return what a day asks of the robot, in order.

    Kinds take turns, so that a week has as many of each; the room to wait in changes every hour.
    """
    rng = stream(seed, "lived", "day", str(home), str(day))
    start = day * DAY_S
    plan = [DayItem(time_s=start + hour * HOUR_S, what="round") for hour in ROUNDS_H]
    for waits_h in range(7, 23):
        room = rooms[int(rng.integers(len(rooms)))]
        plan.append(DayItem(time_s=start + (waits_h + 0.1) * HOUR_S, what="wait", room=room))
    first, last = REQUESTS_H
    hours = sorted(float(hour) for hour in rng.uniform(first, last, size=requests))
    turn = [KINDS[(day * requests + number) % len(KINDS)] for number in range(requests)]
    order = rng.permutation(requests)
    for hour, which in zip(hours, order, strict=True):
        kind = turn[int(which)]
        plan.append(DayItem(time_s=start + hour * HOUR_S, what="request", kind=kind))
    return tuple(sorted(plan, key=lambda one: one.time_s))
