"""In which order places are looked at: chance of finding against the way there."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from karma.agent.search import best_next
from karma.contracts import Fact, LikelyPlace
from karma.household.places import LIKELY
from karma.household.types import object_types
from karma.methods.lived.body import HomeRobot

LOOK_ACTIONS = 4  # that a look costs beside the way, about


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedLook:
    """One place to look at next, and whether memory says that the thing is there."""

    place_id: str
    believed: bool  # memory has seen the thing there last and knows nothing newer


def looks(
    robot: HomeRobot,
    object_type: str | None,
    believed: Sequence[Fact],
    likely: Callable[[], Sequence[LikelyPlace]],
) -> Iterator[PlannedLook]:
    """Yield places to look at, each once, the best from where the robot then stands.

    Where the memory gives chances, by chance over cost, asked for anew after every look. Without
    them what it believes comes first, then furniture in the order of a household's habits.

    Args:
        robot: where it stands.
        object_type: of what is looked for; None: not known.
        believed: the newest facts about what may be meant, the likeliest first.
        likely: asks the memory; () without an opinion.
    """
    home, done = robot.map, set[str]()
    last = {fact.sighting.place_id or "": fact for fact in reversed(believed)}
    sure = {place_id: fact.holds for place_id, fact in last.items() if fact.holds is not None}
    if not sure:
        for place_id in last:
            if place_id in home.spots and place_id not in done:
                done.add(place_id)
                yield PlannedLook(place_id=place_id, believed=True)
    while True:
        said = {place.place_id: place.chance for place in likely()} or sure
        chances = {
            place_id: chance
            for place_id, chance in said.items()
            if place_id in home.spots and place_id not in done and chance > 0
        }
        if not chances:
            break
        best = max(chances, key=lambda one: (chances[one] / look_cost(robot, one), one))
        done.add(best)
        yield PlannedLook(place_id=best, believed=best in last)
    for place_id in by_habit(robot, object_type):
        if place_id not in done:
            done.add(place_id)
            yield PlannedLook(place_id=place_id, believed=False)


def look_cost(robot: HomeRobot, place_id: str) -> float:
    """Return how many actions a look at a place costs from here."""
    return LOOK_ACTIONS + robot.way(place_id)


def by_habit(robot: HomeRobot, object_type: str | None) -> Iterator[str]:
    """Yield furniture that may hold a thing: where things are found at all, the nearest first."""
    types, places = object_types(), robot.map.places
    kind = types.get(object_type or "")
    fitting = [
        place_id
        for place_id, place in places.items()
        if kind is None or kind.fits(types[place.place_type])
    ]
    return best_next(
        fitting, lambda one: (_rank(places[one].place_type), look_cost(robot, one), one)
    )


def nearest_next(robot: HomeRobot, place_ids: Iterable[str]) -> Iterator[str]:
    """Yield places, each the nearest from where the robot then stands."""
    return best_next(place_ids, lambda one: (look_cost(robot, one), one))


def _rank(place_type: str) -> int:
    """Return how late a kind of furniture is looked at: thirds of the household's order."""
    return LIKELY.index(place_type) // 5 if place_type in LIKELY else len(LIKELY)
