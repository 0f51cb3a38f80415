"""What is kept of a prompt: answers are those of a cold model to the bit, and nothing is mixed."""

import numpy as np
import pytest
from support.paths import ROOT
from support.tiny import answer, opened

from karma.testing import make_planner
from karma.types.planning import ProgramSpec, Prompt, Skill

NANO = ROOT / "models" / "nano" / "planner.gguf"
SPEC = ProgramSpec(
    skills=(Skill(name="PutObject", arguments=("object", "object"), optional=1),),
    objects=("Apple", "AppleSliced", "Fridge"), max_calls=4,
)  # fmt: skip
ROOMS = [  # the last is longer than a batch for the models made here
    Prompt(
        stable=f"#areas\nnode_{n} Fridge Sink Toaster\n" * lines, changing="#task go\n#program\n"
    )
    for n, lines in enumerate((3, 4, 5, 60))
]
FAMILIES = ("llama3", "gemma3", "lfm2", "mamba")  # gemma3 attends within a window


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    return {name: make_planner(folder / f"{name}.gguf", name) for name in FAMILIES}


@pytest.mark.parametrize("name", ["nano", *FAMILIES])
def test_warm_answers_are_those_of_a_cold_model_to_the_bit(made, name):
    path, rooms = made.get(name, NANO), ROOMS if name in made else ROOMS[:3]
    cold = [answer(opened(path), room)[1] for room in rooms]
    assert len({bits for _, bits in cold}) == len(rooms)
    model = opened(path)
    for room, said in [*zip(rooms, cold, strict=True)] * 2:
        model.complete(room, max_tokens=2)
        state, again = answer(model, room)
        assert again == said
        assert state == ("kept" if model.gguf._can_rewind else "evaluated")


@pytest.mark.parametrize("name", ["lfm2", "mamba"])
@pytest.mark.parametrize("temperature", [0.0, 1.0])
def test_models_that_cannot_be_rewound_are_held_to_a_grammar(made, name, temperature):
    model = opened(made[name])
    for seed in range(6):
        found = model.complete(ROOMS[0], spec=SPEC, temperature=temperature, seed=seed)
        assert found.constrained and found.finish in ("stop", "cycle")
        assert found.text.startswith("PutObject(robot, '")


def test_earlier_turns_are_read_once(made):
    model = opened(made["llama3"])
    turns = (("put the apple away\n", "pick(Apple)"), ("it is locked\n", "put(Apple, Fridge)"))
    counts = []
    for known in range(3):
        prompt = Prompt(
            stable="You are a robot.\n" * 60, changing="And now?\n", turns=turns[:known]
        )
        warm = model.complete(prompt, max_tokens=3)
        bits = model.gguf.logits().tobytes()
        counts.append(warm.reused_tokens)
        fresh = opened(made["llama3"])
        assert fresh.complete(prompt, max_tokens=3).text == warm.text
        assert np.array_equal(fresh.gguf.logits().tobytes(), bits)
    assert counts[0] == 0 < counts[2]
