"""Decoding of programs: what has to come is decoded in one call, and names are chosen as a whole.

The answers are those of one token after the other, in fewer calls; a name is the likeliest of all,
as scoring each by itself finds it.
"""

import pytest
from support.every_score import every_score
from support.paths import ROOT

from karma.models.automaton import ProgramAutomaton
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.model import LlamaModel, NameBegun, best_name
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.scoring import SkillScorer
from karma.types.planning import ProgramSpec, Prompt, Skill

NANO = ROOT / "models/nano/planner.gguf"
SKILLS = (
    Skill(name="GoToObject", arguments=("object",)),
    Skill(name="PickupObject", arguments=("object",)),
    Skill(name="PutObject", arguments=("object", "object")),
    Skill(name="Explore", arguments=("positions",), optional=1),
)
NAMES = ("Apple", "CounterTop", "Counter_2", "Fridge", "Mug", "Mug_2", "SinkBasin")
TASKS = ("put the apple in the fridge", "wash a mug", "bring everything to the counter", "x")


@pytest.fixture(scope="module")
def planner(mini):
    """A model whose tokens are parts of words, as real models' are; nano has one for each skill."""
    return LlamaModel(mini, options=LlamaOptions(threads=1))


def asked(model, task, names, temperature, refusals=()):
    spec = ProgramSpec(
        skills=SKILLS, objects=names, positions=("node_1", "node_2"), max_calls=9, refusals=refusals
    )
    prompt = Prompt(stable="#areas\nnode_1 Fridge\n", changing=f"#task {task}\n#program\n")
    return model.complete(prompt, spec=spec, temperature=temperature, max_tokens=80)


@pytest.mark.parametrize(
    ("task", "names", "temperature", "refusals"),
    [
        (TASKS[0], NAMES, 0.0, ()),
        (TASKS[1], NAMES[3:], 0.0, ("unclear",)),
        (TASKS[2], NAMES[1:3], 0.6, ()),
        (TASKS[0], NAMES[:1], 0.6, ("unclear",)),
    ],
)
def test_answers_are_those_of_one_token_after_the_other(
    planner, task, names, temperature, refusals
):
    found = asked(planner, task, names, temperature, refusals)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("karma.models.llama.gguf_model._WORTH_GUESSING", (10**9, 10**9))
        alone = asked(planner, task, names, temperature, refusals)
    assert (found.text, found.finish) == (alone.text, alone.finish)
    assert found.completion_tokens == alone.completion_tokens
    # sums of a call of several tokens are taken in another order than those of one
    assert found.certainty.mean_logprob == pytest.approx(alone.certainty.mean_logprob, abs=0.1)


def test_a_program_takes_less_than_half_the_calls(planner, monkeypatch):
    calls = []
    decode = planner.gguf.llama._ctx.decode

    def counted(batch):
        calls.append(batch.n_tokens())
        return decode(batch)

    monkeypatch.setattr(planner.gguf.llama._ctx, "decode", counted)
    found = asked(planner, TASKS[0], NAMES, 0.0)
    assert len(calls) < found.completion_tokens / 2


@pytest.mark.parametrize("guess", ["', 'Fridge", "', 'Mug'", "zzz"])
def test_a_guess_that_does_not_come_true_leaves_no_trace(guess):
    model = GgufModel(NANO, LlamaOptions(threads=1))
    begun, goes_on = model.tokens("#task a\n#program\nPutObject(robot, '"), model.tokens("Apple')")
    model.evaluate([], begun)
    model.extend(goes_on[:1], ahead=model.tokens(guess))
    model.extend(goes_on[1:])
    found = model.logits().copy()
    model.evaluate([], begun)
    model.extend(goes_on[:1])
    model.extend(goes_on[1:])
    assert model.decoded == len(begun) + len(goes_on)
    assert found == pytest.approx(model.logits(), abs=1e-3)


def test_a_guess_never_goes_beyond_the_context():
    model = GgufModel(NANO, LlamaOptions(threads=1, n_ctx=32))
    model.evaluate([], [5] * 30)
    model.extend([6], ahead=[7] * 20)
    model.extend([7])
    assert model.decoded == 32


def test_what_is_expected_ends_at_a_choice_and_passes_over_ends():
    automaton = ProgramAutomaton(ProgramSpec(skills=SKILLS[:2], objects=("Mug", "Mop")))

    def after(text):
        return automaton.expected(automaton.advance(automaton.start(), text))

    assert after("") == b""
    assert after("G") == b"oToObject(robot, 'M"
    assert after("GoToObject(robot, 'Mu") == b"g')\n"
    assert after("GoToObject(robot, 'Mug')") == b"\n"


# ----------------------------------------------------------------- whole names


NAMED = SKILLS[:3]
ROOM = ("CreditCard", "DeskLamp", "SideTable", "CoffeeTable", "Dumbbell", "Bed", "Pillow")
ASKED = "#task place a card on the desk\n#memory\n#program\n"


@pytest.fixture(scope="module")
def weights(smollm):
    return GgufModel(smollm, LlamaOptions(threads=1))


@pytest.mark.parametrize("asked", [ASKED, "#task get the lamp\n#program\n", "Once upon a time, '"])
@pytest.mark.parametrize("names", [ROOM, ("A", "AB", "ABC"), ("Mug", "Mug_2", "Mug_3")])
def test_the_likeliest_name_is_that_of_scoring_all(weights, asked, names):
    spec = ProgramSpec(skills=NAMED, objects=names)
    state = ProgramAutomaton(spec).advance(ProgramAutomaton(spec).start(), "GoToObject(robot, '")
    prompt = f"{asked}GoToObject(robot, '"
    weights.evaluate([], weights.tokens(prompt))
    begun = NameBegun(0, state, weights.decoded, weights.logits().copy())
    word, tokens, chances = best_name(weights, begun)
    words = [f"{name}'" for name in names]
    scores = every_score(SkillScorer(weights), [prompt], words).values
    assert word == words[int(scores.argmax())]
    assert sum(chances) == pytest.approx(scores.max(), abs=0.05)
    assert b"".join(weights.table.pieces[token] for token in tokens) == word.encode()


def test_who_wants_a_desk_does_not_get_a_desk_lamp(planner):
    prompt = Prompt(
        stable="#areas\nnode_1 SideTable CoffeeTable\nnode_2 Bed DeskLamp\n", changing=ASKED
    )
    heard = []
    spec = ProgramSpec(skills=NAMED, objects=ROOM)
    answer = planner.complete(prompt, spec=spec, listen=heard.append)
    assert "PutObject(robot, 'CreditCard'" in answer.text
    assert not {"DeskLamp", "Dumbbell"} & {name for name in ROOM if f"'{name}'" in answer.text}
    assert "".join(one.text for one in heard) == answer.text
