"""Decoding of programs: what has to come is decoded in one call, and changes no answer."""

import pytest
from support.paths import ROOT

from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.types.planning import ProgramSpec, Prompt, Skill

NANO = ROOT / "models/nano/planner.gguf"
SKILLS = (
    Skill(name="GoToObject", arguments=("object",)),
    Skill(name="PickupObject", arguments=("object",)),
    Skill(name="PutObject", arguments=("object", "object")),
    Skill(name="Explore", arguments=("positions",), optional=1),
)
NAMES = ("Apple", "CounterTop", "Counter_2", "Fridge", "Mug", "Mug_2", "SinkBasin")
TASKS = ("put the apple in the fridge", "wash a mug", "bring everything to the counter")


@pytest.fixture(scope="module")
def planner(mini):
    """A model whose tokens are parts of words, as real models' are; nano has one for each skill."""
    return LlamaModel(mini, options=LlamaOptions(threads=1))


def asked(model, task, names, temperature=0.0, refusals=()):
    spec = ProgramSpec(
        skills=SKILLS, objects=names, positions=("node_1", "node_2"), max_calls=9, refusals=refusals
    )
    prompt = Prompt(stable=f"#areas\nnode_1 {' '.join(names)}\n", changing=f"#task {task}\n")
    return model.complete(prompt, spec=spec, temperature=temperature, max_tokens=80)


@pytest.mark.parametrize(
    ("task", "names", "temperature", "refusals"),
    [
        (TASKS[0], NAMES, 0.0, ()),
        (TASKS[1], NAMES[3:], 0.0, ("unclear",)),
        (TASKS[2], NAMES[1:3], 0.6, ()),
    ],
)
def test_answers_are_those_of_one_token_after_the_other(
    planner, task, names, temperature, refusals, monkeypatch
):
    found = asked(planner, task, names, temperature, refusals)
    monkeypatch.setattr(planner.gguf, "_looks_ahead", False)
    alone = asked(planner, task, names, temperature, refusals)
    assert (found.text, found.finish) == (alone.text, alone.finish)
    # sums of a call of several tokens are taken in another order than those of one
    assert found.certainty.mean_logprob == pytest.approx(alone.certainty.mean_logprob, abs=0.1)


def test_a_program_takes_less_than_two_thirds_of_the_calls(planner, monkeypatch):
    calls = []
    decode = planner.gguf.llama._ctx.decode

    def counted(batch):
        calls.append(batch.n_tokens())
        return decode(batch)

    monkeypatch.setattr(planner.gguf.llama._ctx, "decode", counted)
    found = asked(planner, TASKS[0], NAMES)
    assert len(calls) < found.completion_tokens * 2 / 3


@pytest.mark.parametrize("guess", ["', 'Fridge", "', 'Mug'", "zzz"])
def test_a_guess_that_does_not_come_true_leaves_no_trace(guess):
    model = GgufModel(NANO, LlamaOptions(threads=1))
    begun, goes_on = model.tokens("#task a\n#program\nPutObject(robot, '"), model.tokens("Apple')")
    model.evaluate([begun])
    model.extend(goes_on[:1], ahead=model.tokens(guess))
    model.extend(goes_on[1:])
    found = model.logits().copy()
    model.evaluate([begun])
    model.extend(goes_on[:1])
    model.extend(goes_on[1:])
    assert model.llama.n_tokens == len(begun) + len(goes_on)
    assert found == pytest.approx(model.logits(), abs=1e-3)


def test_a_guess_never_goes_beyond_the_context():
    model = GgufModel(NANO, LlamaOptions(threads=1, n_ctx=32))
    model.evaluate([[5] * 30])
    model.extend([6], ahead=[7] * 20)
    model.extend([7])
    assert model.llama.n_tokens == 32
