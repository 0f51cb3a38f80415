"""What `habits.toml` says, checked, and what of it one home has drawn for itself."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from karma.errors import FileError, KarmaError
from karma.files import read_toml
from karma.household.types import object_types

TABLE = Path(__file__).with_name("habits.toml")
_STEPS = 60  # of the bisection that scales a home's moves

Span = tuple[float, float]


class _HabitPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of the table."""


class PeopleHabits(_HabitPart, frozen=True, kw_only=True):
    """What holds for everybody."""

    names: tuple[str, ...]
    wake_h: Span
    sleep_h: Span
    away_chance: float
    away_from_h: Span
    away_to_h: Span
    seconds_per_action: float
    walk_s: Span
    habit: float
    stray: float
    temper: float


class Activity(_HabitPart, frozen=True, kw_only=True):
    """Something that people do, and where things go by it."""

    hours: Span
    rooms: tuple[str, ...]
    to: tuple[str, ...]
    dirties: float = 0.0  # chance
    washes: float = 0.0  # chance


class TypeHabit(_HabitPart, frozen=True, kw_only=True):
    """How often things of a type are moved, and as part of what."""

    rate: float
    activities: tuple[str, ...] = msgspec.field(name="as")


class Habits(_HabitPart, frozen=True, kw_only=True):
    """All of `habits.toml`."""

    people: PeopleHabits
    activities: Mapping[str, Activity]
    types: Mapping[str, TypeHabit]


@cache
def habits() -> Habits:
    """Return the table, read once.

    Raises:
        FileError: it is damaged, or names a type or an activity that there is not.
    """
    table = read_toml(TABLE, Habits)
    for name, habit in table.types.items():
        if name not in object_types():
            raise FileError(TABLE, f"types: there is no type {name!r}")
        for activity in habit.activities:
            if activity not in table.activities:
                raise FileError(TABLE, f"types.{name}: there is no activity {activity!r}")
    for name, one in table.activities.items():
        for place in one.to:
            if place not in object_types():
                raise FileError(TABLE, f"activities.{name}: there is no type {place!r}")
    return table


def rates_drawn(
    things: Mapping[str, str], disturbance: float, rng: np.random.Generator
) -> dict[str, float]:
    """Draw how often a home's movable things, id -> type, are moved: moves a day, by id.

    `disturbance` is the share that is moved on a day.
    """
    table = habits()
    spread = rng.normal(0.0, table.people.temper, size=len(things))
    base = np.array([table.types[t].rate if t in table.types else 0.0 for t in things.values()])
    rates = base * np.exp(spread)
    return dict(zip(things, (rates * _scale(rates, disturbance)).tolist(), strict=True))


def _scale(rates: np.ndarray, disturbance: float) -> float:
    """Return the factor by which rates give the wanted mean chance of at least one move a day."""
    if disturbance <= 0 or not rates.any():
        return 0.0
    low, high = 0.0, 1e4
    for _ in range(_STEPS):
        middle = (low * high) ** 0.5 if low else high / 2
        if float(np.mean(1.0 - np.exp(-rates * middle))) < disturbance:
            low = middle
        else:
            high = middle
    return high


def check_people(count: int) -> None:
    """Raise KarmaError if there are not so many people with names."""
    most = len(habits().people.names)
    if not 0 <= count <= most:
        raise KarmaError(f"{count} people in a home: 0 to {most}\n  To fix: --people 2")
