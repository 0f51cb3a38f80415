"""Homes of several rooms: one floor, doors, walls that hide."""

import msgspec
import pytest

from karma.errors import KarmaError
from karma.plugins.homes.houses import build_home, room_at, rooms_reached
from karma.world.core.scene import check
from karma.world.core.state import Settings, begin
from karma.world.sim import EmbeddedWorld


@pytest.mark.parametrize("rooms", [1, 2, 3, 5, 8, 12])
def test_every_room_is_reached_and_the_scene_holds(rooms):
    home = build_home(rooms, 7, name="home_7")
    check(home, "home_7")
    assert rooms_reached(home) == {room.name for room in home.rooms}
    assert len(home.rooms) == rooms
    assert home.rooms[0].room == "Kitchen"
    assert len({thing.id for thing in home.objects}) == len(home.objects)


def test_equal_arguments_give_equal_bytes_and_others_others():
    first, again = build_home(3, 5), build_home(3, 5)
    assert msgspec.json.encode(first) == msgspec.json.encode(again)
    assert msgspec.json.encode(first) != msgspec.json.encode(build_home(3, 6))


def test_rooms_do_not_overlap_and_things_are_in_their_rooms():
    home = build_home(5, 11)
    for x, z in home.reachable:
        inside = [room for room in home.rooms if room_at(home, x, z) == room]
        assert len(inside) <= 1
    parents = {thing.id: thing for thing in home.objects}
    for thing in home.objects:
        here = room_at(home, thing.center[0], thing.center[2])
        for parent in thing.parents:
            there = parents[parent]
            assert room_at(home, there.center[0], there.center[2]) == here


@pytest.mark.parametrize("things", [30, 120])
def test_a_home_has_as_many_movable_things_as_are_wanted(things):
    home = build_home(4, 2, things=things)
    check(home, "home")
    assert sum("pickupable" in thing.capabilities for thing in home.objects) == things


@pytest.mark.parametrize("rooms", [0, 13])
def test_other_numbers_of_rooms_are_refused(rooms):
    with pytest.raises(KarmaError, match="1 to 12 rooms"):
        build_home(rooms, 0)


def test_walls_hide_what_is_seen_without_them():
    home = build_home(3, 4)
    bare = msgspec.structs.replace(home, walls=msgspec.UNSET)
    with_walls, without = (begin(one, Settings(grid_m=0.25)) for one in (home, bare))
    hidden = 0
    for x, z in home.reachable[::7]:
        room = room_at(home, x, z)
        if room is None:
            continue
        for yaw in (0.0, 90.0, 180.0, 270.0):
            pose = msgspec_pose(with_walls, x, z, yaw)
            there = with_walls.sight_from(pose, visibility_m=1.5).visible
            all_of_it = without.sight_from(pose, visibility_m=1.5).visible
            assert there <= all_of_it
            hidden += len(all_of_it - there)
    assert hidden > 0


def msgspec_pose(state, x, z, yaw):
    """Return a pose at a place."""
    from dataclasses import replace

    return replace(state.pose, position_m=(x, state.pose.position_m[1], z), yaw_deg=yaw)


def test_the_robot_walks_from_room_to_room_by_its_own_steps():
    from karma.agent.body.walk import Walker

    home = build_home(4, 9)
    world = EmbeddedWorld(home)
    walker = Walker(world, max_actions=2_000)
    visited = set()
    for room in home.rooms:
        cell = next(c for c in home.reachable if room_at(home, *c) == room)
        walker.start()
        assert walker.walk_near((cell[0], 0.0, cell[1]))
        x, _, z = world.state.pose.position_m
        visited.add(room_at(home, x, z).name)
    assert visited == {room.name for room in home.rooms}
