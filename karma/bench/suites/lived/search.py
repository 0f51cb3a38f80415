"""In which order places are looked at: chance of finding against the way there."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from karma.agent.body.search import best_next
from karma.bench.suites.lived.body import HomeRobot
from karma.contracts import Fact, LikelyPlace
from karma.household.places import LIKELY
from karma.household.types import object_types

LOOK_ACTIONS = 4  # that a look costs beside the way, about


def looks(
    robot: HomeRobot,
    object_type: str | None,
    believed: Sequence[Fact],
    likely: Callable[[], Sequence[LikelyPlace]],
) -> Iterator[str]:
    """Yield places to look at, each once, the best from where the robot then stands.

    Where the memory gives chances, by chance over cost, asked for anew after every look. Without
    them what it believes comes first, then furniture in the order of a household's habits: where
    things are found at all, the nearest first.

    Args:
        robot: where it stands.
        object_type: of what is looked for; None: not known.
        believed: the newest facts about what may be meant, the likeliest first.
        likely: asks the memory; () without an opinion.
    """
    types, places = object_types(), robot.map.places
    kind = types.get(object_type or "")
    held = {one.sighting.place_id or "": one.holds for one in reversed(believed)}
    sure = {place_id: holds for place_id, holds in held.items() if holds is not None}
    trusted = [] if sure else [one.sighting.place_id for one in believed]

    def asked() -> dict[str, float]:
        return {place.place_id: place.chance for place in likely()} or sure

    def rank(one: str) -> tuple[Any, ...]:
        place_type, cost = places[one].place_type, look_cost(robot, one)
        trust = trusted.index(one) if one in trusted else len(trusted)
        chance = max(chances.get(one, 0.0), 0.0)
        hopeless = not chance and one not in trusted and not fits(place_type)
        return hopeless, trust, -chance / cost, _rank(place_type), cost, one

    def fits(place_type: str) -> bool:
        return kind is None or kind.fits(types[place_type])

    chances = asked()
    for place_id in best_next(places, rank):
        if rank(place_id)[0]:
            break
        yield place_id
        chances = asked()


def look_cost(robot: HomeRobot, place_id: str) -> float:
    """Return how many actions a look at a place costs from here."""
    return LOOK_ACTIONS + robot.way(place_id)


def nearest_next(robot: HomeRobot, place_ids: Iterable[str]) -> Iterator[str]:
    """Yield places, each the nearest from where the robot then stands."""
    return best_next(place_ids, lambda one: (look_cost(robot, one), one))


def _rank(place_type: str) -> int:
    """Return how late a kind of furniture is looked at: thirds of the household's order."""
    return LIKELY.index(place_type) // 5 if place_type in LIKELY else len(LIKELY)
