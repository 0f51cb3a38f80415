"""The embedded world has one agent: whoever speaks to another one is told so, and nothing moves."""

import pytest
from support.household import kitchen

from karma.world.sim import EmbeddedWorld


@pytest.mark.parametrize("agent", [1, 7, -1, "robot2", "0", True, 0.5])
def test_action_of_an_agent_that_is_not_there_is_an_error_by_name(agent):
    world = EmbeddedWorld(kitchen())
    before = world.last_event.metadata["agent"]["position"]
    with pytest.raises(ValueError, match=f"agentId {agent!r}: this world has one agent, 0"):
        world.step("MoveAhead", agentId=agent)
    assert world.last_event.metadata["agent"]["position"] == before


@pytest.mark.parametrize("agent", [0, None])
def test_the_one_agent_may_be_named(agent):
    assert EmbeddedWorld(kitchen()).step("RotateRight", agentId=agent)
