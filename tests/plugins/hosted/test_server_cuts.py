"""Answers of a server cut anywhere, for any reason: nothing is carried out but whole programs."""

import json

import pytest
from support.cut_answers import EVERY, asked
from support.hosted_server import endpoint, plant_key, wire_server

from karma.errors import ServerLost
from karma.plugins.hosted.model import HostedLanguageModel

PROGRAMS = (
    "OpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\nCloseObject(robot, 'Fridge')\n",
    "Explore(robot, 'Mug', ['node_1', (1.0, 0.9, -2.25)])\nThrowObject(robot, 'Mug')\n",
    "ToggleOn(robot, 'Faucet')\n\nToggleOff(robot, 'Faucet')\n",
)
ENDS = ("stop", "eos", "end_turn", None)
CUTS = ("length", "max_tokens", "content_filter")
FAULTS = ("abort", "error", "tool_calls", "anything", "")


def cuts_of(program):
    """Where an answer is cut: each character around the end of a line, some elsewhere."""
    ends = [at for at, char in enumerate(program) if char == "\n"]
    near = {at + step for at in [*ends, len(program)] for step in range(-2, 3)}
    between = range(1, len(program), 1 if EVERY else 11)
    return sorted({*near, *between} & {*range(1, len(program) + 1)})


@pytest.fixture(scope="module")
def server():
    """A hosted model, and a list of what its server says next: text and reason."""
    said = ["", ""]

    def answer(path, body, headers):
        message = {"role": "assistant", "content": said[0]}
        choice = {"index": 0, "message": message, "finish_reason": said[1]}
        return 200, {}, json.dumps({"choices": [choice]}).encode()

    with pytest.MonkeyPatch.context() as patch, wire_server(answer) as (url, _):
        plant_key(patch)
        yield HostedLanguageModel(endpoint(url, "m", retries=0)), said


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("reason", [*ENDS, *CUTS, *FAULTS], ids=str)
def test_answer_of_a_server_is_whole_or_it_is_a_fault(server, program, reason):
    model, heard = server
    whole = [line for line in program.splitlines() if line]
    for cut in cuts_of(program):
        heard[:] = program[:cut], reason
        lines = [line for line in program[:cut].splitlines() if line]
        if reason in FAULTS:
            with pytest.raises(ServerLost):
                asked(model)
        elif reason in CUTS or lines != whole[: len(lines)]:
            assert asked(model) == []
        else:  # the model itself has ended it, with a whole line
            assert asked(model) == lines
