"""Walking, turning, looking, teleporting, also on grids finer than the scene's; asking for ways."""

import math

import pytest
from support.household import find, kitchen

from karma.world.core.state import BODY_M
from karma.world.sim import EmbeddedWorld


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


@pytest.fixture
def fine():
    return EmbeddedWorld(kitchen(), gridSize=0.05)


def place(world):
    x, _, z = world.state.pose.position_m
    return (x, z)


def walk(world, action, most=200, **arguments):
    """Repeat a step until it is refused; return how often it succeeded."""
    for count in range(most):
        if not world.step(action, **arguments):
            return count
    raise AssertionError("nothing ever stops the agent")


# ----------------------------------------------------------------- finer steps


def test_fine_step_moves_by_the_grid_and_not_to_the_next_cell(fine):
    fine.step("MoveAhead")
    assert place(fine) == (0.0, 0.05)
    fine.step("MoveRight")
    assert place(fine) == (0.05, 0.05)
    fine.step("MoveAhead", moveMagnitude=0.5)
    assert place(fine) == (0.05, 0.55)


def test_fine_steps_end_at_the_furniture_not_in_it(fine):
    steps = walk(fine, "MoveAhead")
    _, z = place(fine)
    assert steps >= 10  # 0.5 m of cells ahead, and what is free beyond
    assert z <= 0.9 - BODY_M + 1e-6  # the counter begins at 0.9
    assert (
        "CounterTop" in fine.last_event.message or "is blocking Agent 0" in fine.last_event.message
    )
    assert f"{0.05:.4f}" in fine.last_event.message


def test_free_places_never_have_furniture_within_the_body(fine):
    state = fine.state
    fixed = [
        thing for thing in state.objects.values()
        if thing.type in ("CounterTop", "Fridge", "DiningTable", "GarbageCan")
    ]  # fmt: skip
    on_cells = {(round(x, 2), round(z, 2)) for x, z in state.room.cells.values()}
    for spot in fine.step("GetReachablePositions").metadata["actionReturn"]:
        for one in fixed:
            gap_x = max(abs(spot["x"] - one.center[0]) - one.size[0] / 2, 0)
            gap_z = max(abs(spot["z"] - one.center[2]) - one.size[2] / 2, 0)
            near_cell = any(math.dist((spot["x"], spot["z"]), cell) <= 0.36 for cell in on_cells)
            assert math.hypot(gap_x, gap_z) >= BODY_M - 1e-5 or near_cell


def test_short_step_without_snapping_stays_where_it_ends():
    world = EmbeddedWorld(kitchen(), snapToGrid=False)
    world.step("MoveAhead", moveMagnitude=0.1)
    assert place(world) == (0.0, 0.1)
    world.step("RotateRight", degrees=45)
    world.step("MoveAhead", moveMagnitude=0.1)
    assert place(world) == pytest.approx((0.0707, 0.1707), abs=1e-4)


def test_reachable_positions_of_a_fine_grid_lie_on_it_and_can_be_stood_on(fine):
    coarse = fine.step("GetReachablePositions", gridSize=0.25).metadata["actionReturn"]
    places = fine.step("GetReachablePositions").metadata["actionReturn"]
    assert len(coarse) == len(kitchen().reachable)
    assert "gridSize" in fine.step("GetReachablePositions", gridSize=0.001).message
    assert len(places) > 15 * len(coarse)
    assert places[0] == {"x": 0.0, "y": 0.9, "z": 0.0}
    for spot in places[::97]:
        assert abs(spot["x"] / 0.05 - round(spot["x"] / 0.05)) < 1e-4
        assert fine.step("Teleport", position=spot), fine.last_event.message


# ----------------------------------------------------------------- teleporting


def test_teleport_to_nearly_the_floor_s_height_ends_on_it(world):
    assert world.step("Teleport", x=0.5, y=0.94, z=0.25)
    assert world.last_event.metadata["agent"]["position"] == {"x": 0.5, "y": 0.9, "z": 0.25}


def test_teleport_by_force_goes_anywhere(world):
    assert world.step("Teleport", x=0.1, z=1.2, forceAction=True)
    assert place(world) == (0.1, 1.2)


def test_poses_asked_for_with_an_empty_choice_are_none(world):
    fridge = find(world, "Fridge")
    for choice in ("rotations", "horizons", "standings", "positions"):
        event = world.step("GetInteractablePoses", objectId=fridge, **{choice: []})
        assert event
        assert event.metadata["actionReturn"] == []
    assert "maxPoses" in world.step("GetInteractablePoses", objectId=fridge, maxPoses=0).message


def test_shortest_path_starts_where_it_is_told_to(world):
    table = find(world, "DiningTable")
    start = {"x": -1.0, "y": 0.9, "z": 0.5}
    event = world.step("GetShortestPath", objectId=table, position=start)
    assert event.metadata["actionReturn"]["corners"][0] == start
    event = world.step("GetShortestPath", objectType="DiningTable", rotation=90)
    assert event.metadata["actionReturn"]["corners"][-1]["x"] == 1.0
    assert not world.step("GetShortestPath", objectType="Yacht")
    with pytest.raises(ValueError, match="objectId"):
        world.step("GetShortestPath")


# ----------------------------------------------------------------- what lies in the way


def test_what_was_dropped_on_the_floor_stands_in_the_way_until_it_is_picked_up(world):
    bread = find(world, "Bread")
    before = world.step("GetReachablePositions").metadata["actionReturn"]
    world.step("Teleport", position={"x": 0.0, "y": 0.9, "z": 0.0}, rotation=180)
    world.step("PickupObject", objectId=bread, forceAction=True)
    assert world.step("DropHeldObject")
    event = world.step("MoveAhead")
    assert not event
    assert event.metadata["errorMessage"].startswith("Bread")
    cells = world.step("GetReachablePositions").metadata["actionReturn"]
    assert 0 < len(before) - len(cells) <= 9
    x, z = (event.get_object(bread)["position"][axis] for axis in "xz")
    assert all(math.hypot(x - cell["x"], z - cell["z"]) > BODY_M for cell in cells)
    assert not world.step("Teleport", position={"x": 0.0, "y": 0.9, "z": -0.5})
    assert world.step("PickupObject", objectId=bread, forceAction=True)
    assert len(world.step("GetReachablePositions").metadata["actionReturn"]) == len(before)
    assert world.step("MoveAhead")
