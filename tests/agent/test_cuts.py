"""Answers cut anywhere, for any reason: nothing is carried out but whole programs.

KARMA_CUTS=1 cuts at every place.
"""

import json
import os

import pytest
from support.hosted_server import endpoint, plant_key, wire_server
from support.needs import need_models

from karma.agent.planning.planner import Planner
from karma.errors import ServerLost
from karma.models.llama.model import LlamaModel
from karma.models.manifest import resolve_planner
from karma.plugins.hosted.model import HostedLanguageModel
from karma.types.completion import Decoding
from karma.types.memory import Area, MemoryUnit
from karma.types.planning import PlanRequest

PROGRAMS = (
    "OpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\nCloseObject(robot, 'Fridge')\n",
    "Explore(robot, 'Mug', ['node_1', (1.0, 0.9, -2.25)])\nThrowObject(robot, 'Mug')\n",
    "ToggleOn(robot, 'Faucet')\n\nToggleOff(robot, 'Faucet')\n",
)
AREAS = (Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("Fridge", "Faucet", "Sink")),)
UNITS = tuple(
    MemoryUnit(object_id=f"{kind}|1", object_type=kind, position_m=(0, 0, 0))
    for kind in ("Apple", "Mug")
)
ENDS = ("stop", "eos", "end_turn", None)
CUTS = ("length", "max_tokens", "content_filter")
FAULTS = ("abort", "error", "tool_calls", "anything", "")
EVERY = bool(os.environ.get("KARMA_CUTS"))


def asked(model, said="Do it", **decoding):
    """What is carried out of one answer of a model."""
    request = PlanRequest(instruction=said, areas=AREAS, units=UNITS)
    (plan,) = Planner(model, "compact", Decoding(attempts=1, **decoding)).plan(request)
    assert plan.calls or plan.error or plan.refused
    return [str(call) for call in plan.calls]


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


@pytest.mark.parametrize(
    "said", ["Wash the mug", "Put the apple in the fridge, then open the fridge", "Slice the apple"]
)
def test_answer_of_a_local_model_is_whole_or_it_is_a_fault(said):
    need_models("karma-nano")
    file = resolve_planner("karma-nano")
    model = LlamaModel(file.path, sha256=file.sha256, name=file.name)
    request = PlanRequest(instruction=said, areas=AREAS, units=UNITS)
    for level in ("types", "free"):  # some tokens, and each of the last where it is whole
        (plan,) = Planner(model, "compact", Decoding(attempts=1, constraint=level)).plan(request)
        whole, tokens = [str(call) for call in plan.calls], plan.completion.completion_tokens
        assert whole and plan.completion.finish == "stop"
        for most in {*range(1, tokens, 1 if EVERY else 7), tokens - 2, tokens - 1, tokens} - {0}:
            found = asked(model, said, constraint=level, max_tokens=most)
            assert found in ([], whole)
            assert not found or most >= tokens - 1  # but for a line break that ends it
    model.close()
