"""The robot's body in a home: doors are shut again, deeds nearby are witnessed, hands hold one."""

import pytest

from karma.household.places import HAND
from karma.plugins.homes.lived.body import HomeRobot
from karma.plugins.homes.residents import ACTION_S, Household
from tests.support.lived import DAY_S, small_home, small_map

ROOMS = ((2, 4), (3, 11))


def robot_in(rooms=2, seed=4, people=0):
    """Return a robot in a home, and the list of what it learns."""
    household = Household(small_home(rooms, seed), seed=seed, people=people, disturbance=0.5)
    moments = []
    return HomeRobot(household, small_map(rooms, seed), moments.append), moments


def shut(robot):
    """Return the ids of closed furniture, by the world itself."""
    objects = robot.household.world.state.objects.values()
    return {
        one.id for one in objects if "openable" in one.capabilities and one.openness <= 0
    } & robot.map.places.keys()


@pytest.mark.parametrize(("rooms", "seed"), ROOMS)
def test_what_was_opened_to_look_is_shut_again_and_was_seen_into(rooms, seed):
    robot, moments = robot_in(rooms, seed)
    closed = shut(robot)
    inside = {
        one.id: one.parents
        for one in robot.household.world.state.objects.values()
        if "pickupable" in one.capabilities and closed & set(one.parents)
    }
    for place_id in closed:
        robot.look_at(place_id)
    seen = {one.object_id for moment in moments for one in moment.seen}
    assert shut(robot) == closed
    assert len(inside) > 3
    assert len(inside.keys() & seen) >= 0.9 * len(inside)
    places = {one.object_id: one.place_id for moment in moments for one in moment.seen}
    assert all(places[one] in parents for one, parents in inside.items() if one in places)


def test_a_look_ends_where_the_thing_is_found():
    robot, moments = robot_in()
    place_id = max(robot.map.spots, key=lambda one: len(robot.map.spots[one]))
    assert robot.look_at(place_id, until=lambda moment: True)
    looks = [one for one in moments if one.deed is None]
    assert len(looks) == 1
    assert not robot.look_at(place_id, until=lambda moment: False)
    assert len([one for one in moments if one.deed is None]) == 1 + len(robot.map.spots[place_id])


@pytest.mark.parametrize(("rooms", "seed"), ROOMS)
def test_deeds_in_its_room_are_witnessed_and_no_others(rooms, seed):
    robot, moments = robot_in(rooms, seed, people=2)
    robot.wait(2 * DAY_S)
    log = robot.household.log
    told = [one.deed for one in moments]
    assert told == [one for one in log if one.room == robot.room]
    assert 0 < len(told) < len(log)
    for moment in moments:
        carried = moment.deed.action == "PickupObject"
        assert all((one.place_id == HAND) == carried for one in moment.seen)
        assert all(one.object_id == moment.deed.object_id for one in moment.seen)
        assert all(one.time_s == moment.deed.time_s for one in moment.seen)


def test_a_walk_is_charged_step_by_step_and_takes_its_time():
    robot, _ = robot_in()
    place_id = [one for one, spots in robot.map.spots.items() if len(spots) == 1][-1]
    (spot,) = robot.map.spots[place_id]
    cost, before, began_s = robot.way(place_id), robot.actions, robot.time_s
    assert cost > 1
    assert robot.go(spot)
    assert robot.actions - before == cost
    assert robot.time_s - began_s == cost * ACTION_S
    pose = robot.household.world.state.pose
    assert pose.position_m == pytest.approx(spot.position_m)
    assert (pose.yaw_deg, pose.horizon_deg) == (spot.yaw_deg, spot.horizon_deg)
    assert robot.way(place_id) == 0


def test_a_hand_takes_one_thing_and_puts_it_down():
    robot, moments = robot_in()
    things = [
        one
        for one in robot.household.world.state.objects.values()
        if "pickupable" in one.capabilities and set(one.parents) & robot.map.places.keys()
        and not robot.map.places[one.parents[0]].openable
    ]  # fmt: skip
    first, second = things[:2]
    robot.look_at(first.parents[0])
    assert robot.take(first.id)
    assert robot.held == first.id
    assert not robot.take(second.id)
    assert robot.held == first.id
    in_hand = [one for moment in moments for one in moment.seen if one.object_id == first.id][-1]
    assert in_hand.place_id == HAND
    robot.put_down()
    assert robot.held is None
    put = next(one.deed for one in reversed(moments) if one.deed is not None)
    assert (put.who, put.action, put.object_id) == ("robot", "PutObject", first.id)
    assert put.place_id in robot.map.places
