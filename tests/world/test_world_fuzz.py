"""No step, however wrong, does anything but what is documented: an event, or ValueError for misuse.

6,000 steps; KARMA_FUZZ_STEPS sets another number.
"""

import math
import os
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_steps import random_step

from karma.world.core import scene
from karma.world.sim import MISUSE, EmbeddedWorld

STEPS = int(os.environ.get("KARMA_FUZZ_STEPS", "6000"))
RUN = 50
NAMES = sorted(path.stem for path in scene.SCENES.glob("*.json"))


def numbers(value):
    if isinstance(value, float):
        yield value
    elif isinstance(value, dict):
        for inner in value.values():
            yield from numbers(inner)
    elif isinstance(value, (list, tuple)):
        for inner in value:
            yield from numbers(inner)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=max(STEPS // RUN // len(NAMES), 1))
@given(seed=st.integers(0, 2**32))
def test_random_steps_raise_nothing_but_misuse(name, seed):
    world, draw = EmbeddedWorld(name), random.Random(seed)
    for _ in range(RUN):
        if not 5 <= len(world.state.objects) <= 400:
            world.reset(name)
        action = random_step(draw, world.state.objects)
        before = world.last_event
        try:
            event = world.step(**action)
        except ValueError as error:
            event = world.last_event
            assert event.metadata["errorCode"] in MISUSE
            assert str(error) == event.metadata["errorMessage"]
            assert event.state is before.state
        assert event.metadata["lastActionSuccess"] == (event.metadata["errorMessage"] == "")
        assert len(event.metadata) == 37
    assert all(len(thing) == 42 for thing in event.metadata["objects"])
    assert all(map(math.isfinite, numbers(event.metadata)))
