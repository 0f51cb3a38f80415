"""What this home has shown, beside a prior: how long a thing stays where it is, and where it goes.

Moves of a thing are taken as a Poisson process with an unknown rate, in the time of its type: an
hour of the day counts as much as such things are moved in it. The rate has a Gamma distribution: a
prior for the type from training homes (`prior.json`), made sharper by what this home showed of the
type and of the very thing. With shape a and rate b (hours) the chance of no move within t hours is
(b / (b + t)) ** a, the Gamma-Poisson mixture (a Lomax tail). A thing that has moved may be back:
that is added by its share of places.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Generic, TypeVar

import msgspec

from karma.files import read_json
from karma.plugins.homes.memory.setting import KnownPlace

PRIOR = Path(__file__).with_name("prior.json")
DAY_S, HOUR_S = 86_400.0, 3_600.0
AT_NIGHT = 0.02  # of an hour, what an hour of the night counts
_UP = (AT_NIGHT,) * 6 + (0.5,) + (1.0,) * 16 + (AT_NIGHT,)
BY_HOUR = _UP + _UP  # of a weekday, then of a day of the weekend; for any type
WEEK = (5, 2)  # days of each, in this order
HOME = 8.0  # moves that the priors are worth against how busy this home is
SURE = 0.005  # chances are kept so far from 0 and 1
OWN = 48.0  # hours of evidence that a type's rate is worth for one thing of it
PARTS = OF_HOME, OF_TYPES, OF_THINGS = "moves of the home", "moves of types", "moves of things"


class TypePrior(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What training homes showed of a type."""

    moves: float  # shape of the Gamma distribution
    hours: float  # its rate, hours of its own time
    places: dict[str, float]  # "kitchen/Cabinet": share of the time in such places
    by_hour: Annotated[tuple[float, ...], msgspec.Meta(min_length=48, max_length=48)] = BY_HOUR


class AskedFor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What being asked for says about a thing: people ask for what they do not find.

    The chance that a thing is where it was seen is a logistic function of the chance by its age.
    """

    shift: float = 0.0
    slope: float = 1.0

    def chance(self, aged: float) -> float:
        """Return the chance of a thing that is asked for.

        >>> round(AskedFor(shift=0.0, slope=1.0).chance(0.8), 3)
        0.8
        """
        odds = math.log(max(aged, SURE) / max(1.0 - aged, SURE))
        return 1.0 / (1.0 + math.exp(-(self.shift + self.slope * odds)))


class HomePrior(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of `prior.json`."""

    homes: int  # that it was fitted on
    asked: dict[str, AskedFor] = {}  # by how a thing is asked for, see `true_memory`
    types: dict[str, TypePrior]


@cache
def home_prior() -> HomePrior:
    """Return the prior from training homes, read once; FileError where it is torn."""
    return read_json(PRIOR, HomePrior)


FLAT = TypePrior(moves=0.5, hours=12.0, places={})  # of a type that no training home had


class OwnTime:
    """The time of a type: its hours are long when such things are moved, and short when not.

    An hour of a weekday has its own weight, and so has one of a day of the weekend.

    >>> round(OwnTime().hours(8 * 3600.0, 10 * 3600.0), 6)
    2.0
    """

    def __init__(self, by_hour: Sequence[float] = BY_HOUR) -> None:
        days, ends = tuple(by_hour[:24]), tuple(by_hour[24:])
        self._by_hour = days * WEEK[0] + ends * WEEK[1]
        self._before = (0.0, *accumulate(self._by_hour))  # an hour of the week

    def hours(self, start_s: float, end_s: float) -> float:
        """Return how many hours lie between two times of a home's clock."""
        return self._until(end_s) - self._until(start_s)

    def _until(self, time_s: float) -> float:
        week, second = divmod(time_s, sum(WEEK) * DAY_S)
        hour, part_s = divmod(second, HOUR_S)
        at = int(hour)
        return week * self._before[-1] + self._before[at] + part_s / HOUR_S * self._by_hour[at]


def _until_moved(per_hour: float, hours: float) -> float:
    """Return after how many hours, on average, a thing was moved that was moved within some.

    That is the step of expectation for intervals that are only seen from their ends (Dempster,
    Laird and Rubin 1977): half of a short one, no more than the usual stay of a long one.
    """
    turns = per_hour * hours
    if turns < 1e-3:
        return hours / 2
    return 1.0 / per_hour - hours / math.expm1(min(turns, 500.0))


T = TypeVar("T")


class Shown(Generic[T]):
    """What a home has shown, by part and name; `made` makes an empty entry."""

    def __init__(self, parts: Sequence[str], made: Callable[[], T]) -> None:
        self._parts: dict[str, dict[str, T]] = {part: {} for part in parts}
        self._made = made

    def get(self, part: str, name: str) -> T:
        """Return an entry; an empty one where nothing was shown."""
        return self._parts[part].get(name) or self._made()

    def changing(self, part: str, name: str) -> T:
        """Return an entry that is changed now."""
        return self._parts[part].setdefault(name, self._made())


def _evidence() -> list[float]:
    """Return no moves in no hours; of the home, expected moves stand for hours."""
    return [0.0, 0.0]


class Ageing:
    """What this home has shown of how often its things are moved."""

    def __init__(self, priors: Mapping[str, TypePrior]) -> None:
        self._priors = priors
        self._times = {name: OwnTime(prior.by_hour) for name, prior in priors.items()}
        self._any_time = OwnTime()
        self.shown = Shown(PARTS, _evidence)

    def learn(self, object_id: str, object_type: str, hours: float, *, moved: bool) -> None:
        """Count what was found after a time: still there, or moved at some time in between."""
        shape, rate = self._gamma(object_id, object_type)
        exposure = _until_moved(shape / rate, hours) if moved else hours
        prior = self._priors.get(object_type, FLAT)
        expected = exposure * prior.moves / prior.hours  # moves, by the prior alone
        for part, name, more in (
            (OF_HOME, "", expected), (OF_TYPES, object_type, exposure),
            (OF_THINGS, object_id, exposure),
        ):  # fmt: skip
            evidence = self.shown.changing(part, name)
            evidence[0] += moved
            evidence[1] += more

    def hours(self, object_type: str, start_s: float, end_s: float) -> float:
        """Return how many hours of a type's own time lie between two times."""
        return self._times.get(object_type, self._any_time).hours(start_s, end_s)

    def stays(self, object_id: str, object_type: str, hours: float) -> float:
        """Return the chance that a thing was not moved for so many hours of its type."""
        shape, rate = self._gamma(object_id, object_type)
        return float((rate / (rate + hours)) ** shape)

    def _gamma(self, object_id: str, object_type: str) -> tuple[float, float]:
        """Return shape and rate for one thing: the type's mean, worth `OWN` hours, and its own."""
        prior = self._priors.get(object_type, FLAT)
        of_home, expected = self.shown.get(OF_HOME, "")
        of_type, type_hours = self.shown.get(OF_TYPES, object_type)
        own, own_hours = self.shown.get(OF_THINGS, object_id)
        busy = (HOME + of_home) / (HOME + expected)
        mean = (prior.moves * busy + of_type) / (prior.hours + type_hours)
        return mean * OWN + own, OWN + own_hours


# ----------------------------------------------------------------- where things go


OWN_VISIT, LIKE_VISIT, OF_PRIOR = 1.0, 0.15, 4.0  # what one counts against another
_SPREAD = 0.15  # of the prior, over all places of the home
BY_THING, BY_TYPE = "places of things", "places of types"


class PlaceShares:
    """Counts of the places that things were brought to, in this home, and a prior beside them."""

    def __init__(self, prior: HomePrior, places: Mapping[str, KnownPlace]) -> None:
        self._prior, self._places = prior.types, places
        self.visits: Shown[Counter[str]] = Shown((BY_THING, BY_TYPE), Counter)
        self._kinds = Counter(_kind(place) for place in places.values())
        self._base: dict[str, dict[str, float]] = {}

    def visit(self, object_id: str, object_type: str, place_id: str | None) -> None:
        """Count that a thing has come to a place."""
        if place_id not in self._places:
            return
        for part, name in ((BY_THING, object_id), (BY_TYPE, object_type)):
            self.visits.changing(part, name)[str(place_id)] += 1

    def of(self, object_ids: Iterable[str], object_type: str) -> dict[str, float]:
        """Return each place's share for a thing that may be one of some, summing to 1."""
        found = dict(self._base_of(object_type))
        for place_id, times in self.visits.get(BY_TYPE, object_type).items():
            found[place_id] = found.get(place_id, 0.0) + LIKE_VISIT * times
        for object_id in object_ids:
            for place_id, times in self.visits.get(BY_THING, object_id).items():
                found[place_id] = found.get(place_id, 0.0) + OWN_VISIT * times
        total = sum(found.values())
        return {place_id: share / total for place_id, share in found.items()} if total else {}

    def _base_of(self, object_type: str) -> dict[str, float]:
        if object_type not in self._base:
            prior = self._prior.get(object_type)
            self._base[object_type] = self._spread(prior) if prior else {}
        return self._base[object_type]

    def _spread(self, prior: TypePrior) -> dict[str, float]:
        """Return the prior's shares of kinds of places over the places of this home."""
        number = max(len(self._places), 1)
        return {
            place_id: OF_PRIOR
            * (
                (1.0 - _SPREAD) * prior.places.get(_kind(place), 0.0) / self._kinds[_kind(place)]
                + _SPREAD / number
            )
            for place_id, place in self._places.items()
        }


def _kind(place: KnownPlace) -> str:
    """Return the kind of a place as the prior has it."""
    return f"{place.room_kind}/{place.place_type}"
