"""Looks at furniture show what lies there, and take as few places to stand as that needs."""

import pytest

from karma.household.places import HAND
from karma.plugins.homes.lived.body import HomeRobot
from karma.plugins.homes.residents import Household
from tests.support.lived import HOUR_S, small_home, small_map

HOMES = [(2, 4), (3, 11), (4, 23)]


@pytest.mark.parametrize(("rooms", "seed"), HOMES)
def test_a_look_over_a_place_shows_what_is_there(rooms, seed):
    home = small_map(rooms, seed)
    household = Household(small_home(rooms, seed), seed=seed, people=2, disturbance=0.4)
    shown, there = 0, 0
    for hour in (8, 20, 32):
        household.until(hour * HOUR_S)
        moments = []
        robot = HomeRobot(household, home, moments.append)
        for place_id in home.places:
            first = len(moments)
            robot.look_at(place_id)
            seen = {one.object_id for moment in moments[first:] for one in moment.seen}
            resting = _resting(household, home, place_id)
            there += len(resting)
            shown += len(resting & seen)
    assert there > 100
    assert shown >= 0.95 * there


def _resting(household, home, place_id):
    """Return what lies in or on a place, by the world's own chains of parents."""
    objects = household.world.state.objects
    found = set()
    for thing in objects.values():
        holder = thing
        while holder is not None and holder.id not in home.places:
            holder = objects.get(holder.parents[0]) if holder.parents else None
        movable = "pickupable" in thing.capabilities and not (thing.is_broken or thing.is_sliced)
        if holder is not None and holder.id == place_id and movable and place_id != HAND:
            found.add(thing.id)
    return found


@pytest.mark.parametrize(("rooms", "seed"), HOMES)
def test_most_places_need_one_look_and_none_more_than_three(rooms, seed):
    spots = small_map(rooms, seed).spots.values()
    assert max(len(one) for one in spots) <= 3
    assert sum(len(one) == 1 for one in spots) > 0.7 * len(spots)


def test_a_look_says_since_when_it_looked():
    household = Household(small_home(), seed=0, people=0, disturbance=0.0)
    moments = []
    robot = HomeRobot(household, small_map(), moments.append)
    place_id = next(one for one, spots in robot.map.spots.items() if len(spots) > 1)
    began_s = robot.time_s
    robot.look_at(place_id)
    last = next(moment for moment in reversed(moments) if moment.looked_over)
    assert last.looked_over == (place_id,)
    assert last.looked_since_s == began_s < last.time_s
