"""Where a thing may be: where it has been, its like has been, and such things are at all."""

from collections import Counter
from collections.abc import Iterable, Mapping

from karma.memory.lived.ageing import HomePrior, TypePrior
from karma.memory.lived.setting import KnownPlace

OWN_VISIT, LIKE_VISIT, PRIOR = 1.0, 0.15, 4.0  # what one counts against another
_SPREAD = 0.15  # of the prior, over all places of the home


class PlaceShares:
    """Counts of the places that things were brought to, in this home.

    Args:
        prior: from training homes.
        places: of this home.
    """

    def __init__(self, prior: HomePrior, places: Mapping[str, KnownPlace]) -> None:
        self._prior, self._places = prior.types, places
        self._own: dict[str, Counter[str]] = {}
        self._like: dict[str, Counter[str]] = {}
        self._kinds = Counter(_kind(place) for place in places.values())
        self._base: dict[str, dict[str, float]] = {}
        self._fresh: dict[str, None] = {}  # keys that changed since they were told last

    def visit(self, object_id: str, object_type: str, place_id: str | None) -> None:
        """Count that a thing has come to a place."""
        if place_id in self._places:
            self._fresh |= {f"own {object_id}": None, f"like {object_type}": None}
            self._own.setdefault(object_id, Counter())[str(place_id)] += 1
            self._like.setdefault(object_type, Counter())[str(place_id)] += 1

    def fresh(self) -> dict[str, dict[str, int]]:
        """Return the counts that changed since this was asked last, by keys for `visit_again`."""
        found = {}
        for key in self._fresh:
            kind, _, name = key.partition(" ")
            found[key] = dict((self._own if kind == "own" else self._like)[name])
        self._fresh.clear()
        return found

    def visit_again(self, kept: Mapping[str, Mapping[str, int]]) -> None:
        """Take over counts of before a restart."""
        for key, counts in kept.items():
            kind, _, name = key.partition(" ")
            (self._own if kind == "own" else self._like)[name] = Counter(counts)

    def of(self, object_ids: Iterable[str], object_type: str) -> dict[str, float]:
        """Return each place's share for a thing that may be one of some, summing to 1."""
        found = dict(self._base_of(object_type))
        for place_id, times in self._like.get(object_type, {}).items():
            found[place_id] = found.get(place_id, 0.0) + LIKE_VISIT * times
        for object_id in object_ids:
            for place_id, times in self._own.get(object_id, {}).items():
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
