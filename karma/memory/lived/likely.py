"""Where a thing may be: where it has been, its like has been, and such things are at all."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from karma.memory.lived.ageing import HomePrior, TypePrior
from karma.memory.lived.setting import KnownPlace

OWN_VISIT, LIKE_VISIT, PRIOR = 1.0, 0.15, 4.0  # what one counts against another
_SPREAD = 0.15  # of the prior, over all places of the home
PARTS = OF_THINGS, OF_TYPES = "places of things", "places of types"


class PlaceShares:
    """Counts of the places that things were brought to, in this home, and a prior beside them."""

    def __init__(self, prior: HomePrior, places: Mapping[str, KnownPlace]) -> None:
        self._prior, self._places = prior.types, places
        self._visits: dict[str, dict[str, Counter[str]]] = {part: {} for part in PARTS}
        self._kinds = Counter(_kind(place) for place in places.values())
        self._base: dict[str, dict[str, float]] = {}
        self._fresh: dict[tuple[str, str], None] = {}  # that changed since it was told last

    def visit(self, object_id: str, object_type: str, place_id: str | None) -> None:
        """Count that a thing has come to a place."""
        if place_id not in self._places:
            return
        for part, name in ((OF_THINGS, object_id), (OF_TYPES, object_type)):
            self._visits[part].setdefault(name, Counter())[str(place_id)] += 1
            self._fresh[part, name] = None

    def fresh(self) -> dict[str, dict[str, Any]]:
        """Return the counts that changed since this was asked last, by part and name."""
        found: dict[str, dict[str, Any]] = {}
        for part, name in self._fresh:
            found.setdefault(part, {})[name] = dict(self._visits[part][name])
        self._fresh.clear()
        return found

    def visit_again(self, kept: Callable[[str], Mapping[str, Any]]) -> None:
        """Take over counts of before a restart, by part."""
        for part, visits in self._visits.items():
            visits |= {name: Counter(counts) for name, counts in kept(part).items()}

    def of(self, object_ids: Iterable[str], object_type: str) -> dict[str, float]:
        """Return each place's share for a thing that may be one of some, summing to 1."""
        found = dict(self._base_of(object_type))
        for place_id, times in self._visits[OF_TYPES].get(object_type, {}).items():
            found[place_id] = found.get(place_id, 0.0) + LIKE_VISIT * times
        for object_id in object_ids:
            for place_id, times in self._visits[OF_THINGS].get(object_id, {}).items():
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
            place_id: PRIOR
            * (
                (1.0 - _SPREAD) * prior.places.get(_kind(place), 0.0) / self._kinds[_kind(place)]
                + _SPREAD / number
            )
            for place_id, place in self._places.items()
        }


def _kind(place: KnownPlace) -> str:
    """Return the kind of a place as the prior has it."""
    return f"{place.room_kind}/{place.place_type}"
