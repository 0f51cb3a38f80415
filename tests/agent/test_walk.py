"""Ways over a floor are the shortest, whatever is in the way."""

from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.agent.body.walk import FloorMap, Routes

AHEAD = ((0, 1), (1, 0), (0, -1), (-1, 0))
CELLS = st.sets(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=30)
MOVES = ("MoveAhead", "RotateLeft", "RotateRight")


def after(state, move):
    """Return where a move leads."""
    x, z, heading = state
    if move == "MoveAhead":
        return x + AHEAD[heading][0], z + AHEAD[heading][1], heading
    return x, z, (heading + (1 if move == "RotateRight" else -1)) % 4


def plain_costs(cells, start, walls):
    """Return the cost of every state that can be reached, found state by state."""
    costs, waiting = {start: 0}, deque([start])
    while waiting:
        state = waiting.popleft()
        for move in MOVES:
            there = after(state, move)
            if there[:2] in cells and there not in costs and (state, move) not in walls:
                costs[there] = costs[state] + 1
                waiting.append(there)
    return costs


@given(cells=CELLS, data=st.data())
def test_ways_are_the_shortest_round_all_walls(cells, data):
    at = data.draw(st.sampled_from(sorted(cells)))
    floor = FloorMap([(x, 0.0, z) for x, z in [*cells, (9, 9), (10, 9)]], (at[0], 0.0, at[1]))
    states = sorted(floor.numbers)
    walls = data.draw(st.sets(st.tuples(st.sampled_from(states), st.sampled_from(MOVES))))
    start = (0, 0, data.draw(st.integers(0, 3)))
    routes, costs = Routes(floor, start, walls), plain_costs(floor.cells, start, walls)
    assert routes.costs == costs
    for goal in states:
        assert routes.costs.get(goal) == costs.get(goal)
        way, here = routes.to(goal), start
        assert (way is None) == (goal not in costs)
        for move in way or ():
            assert (here, move) not in walls
            here = after(here, move)
        assert way is None or (here, len(way)) == (goal, costs[goal])


def test_where_no_way_leads_costs_nothing_that_is_a_number():
    floor = FloorMap([(0.0, 0.0, 0.0), (0.25, 0.0, 0.0), (2.0, 0.0, 0.0)], (0.0, 0.0, 0.0))
    routes = Routes(floor, (0, 0, 0))
    assert routes.costs.get((8, 0, 0)) is None
    assert routes.to((8, 0, 0)) is None
    assert routes.costs.get((3, 3, 0)) is None
    floor.add((1.75, 0.0, 0.0))
    assert Routes(floor, (7, 0, 1)).to((8, 0, 1)) == ["MoveAhead"]


@pytest.mark.parametrize("turns", range(4))
def test_turns_are_quarters_by_the_shorter_side(turns):
    routes = Routes(FloorMap((), (0.0, 0.0, 0.0)), (0, 0, 0))
    assert routes.costs.get((0, 0, turns)) == min(turns, 4 - turns)
