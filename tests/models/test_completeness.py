"""An answer that goes round in circles is told from one that goes on."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.agent.planning.recovery import program_of
from karma.errors import ProgramError
from karma.models.completeness import LONGEST, cycle, repeated
from karma.types.completion import Completion

LINES = st.lists(st.sampled_from("abc"), max_size=14)


def brute(lines):
    """Every size and every place, by slices."""
    for end in range(len(lines) + 1):
        for size in range(1, LONGEST + 1):
            block = lines[max(end - size, 0) : end]
            if end >= 3 * size and lines[end - 3 * size : end] == block * 3:
                return end, size
    return None


@given(lines=LINES)
def test_first_third_round_is_found_where_slices_find_it(lines):
    assert repeated(lines) == brute(lines)
    assert (cycle(lines) > 0) == (
        brute(lines[:]) is not None
        and any(
            lines[-3 * s :] == lines[-s:] * 3 for s in range(1, LONGEST + 1) if len(lines) >= 3 * s
        )
    )


def said(text, **more):
    how = {"finish": "stop", "prompt_tokens": 1, "reused_tokens": 0, "completion_tokens": 1,
           "first_token_s": None, "total_s": 0.0, **more}  # fmt: skip
    return Completion(text=text, **how)


@pytest.mark.parametrize("constrained", [True, False])
@pytest.mark.parametrize(
    "cycle_",
    [
        ["ToggleOn(robot, 'Fridge')"],
        ["ToggleOn(robot, 'Fridge')", "ToggleOff(robot, 'Fridge')"],
        [f"GoToObject(robot, '{name}')" for name in ("Mug", "Sink", "Fridge", "Egg")],
    ],
)
def test_program_that_goes_in_circles_is_a_fault_whoever_said_it(cycle_, constrained):
    first = ["GoToObject(robot, 'Apple')"]
    twice = "\n".join([*first, *cycle_ * 2])
    assert len(program_of(said(twice, constrained=constrained)).calls) == 1 + 2 * len(cycle_)
    with pytest.raises(ProgramError, match="for the third time") as caught:
        program_of(said("\n".join([*first, *cycle_ * 3]), constrained=constrained))
    assert caught.value.line == 1 + 3 * len(cycle_)
