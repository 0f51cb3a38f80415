"""Names are chosen as a whole: the likeliest of all, as scoring each by itself finds it."""

import pytest
from support.every_score import every_score

from karma.contracts import ProgramSpec, Prompt, Skill
from karma.infer.automaton import ProgramAutomaton
from karma.infer.llama.gguf_model import GgufModel
from karma.infer.llama.model import LlamaModel, NameBegun, best_name
from karma.infer.llama.opening import LlamaOptions
from karma.infer.llama.scoring import SkillScorer

SKILLS = (
    Skill(name="GoToObject", arguments=("object",)),
    Skill(name="PickupObject", arguments=("object",)),
    Skill(name="PutObject", arguments=("object", "object")),
)
ROOM = ("CreditCard", "DeskLamp", "SideTable", "CoffeeTable", "Dumbbell", "Bed", "Pillow")
ASKED = "#task place a card on the desk\n#memory\n#program\n"


@pytest.fixture(scope="module")
def model(smollm):
    return GgufModel(smollm, LlamaOptions(threads=1))


@pytest.mark.parametrize("asked", [ASKED, "#task get the lamp\n#program\n", "Once upon a time, '"])
@pytest.mark.parametrize("names", [ROOM, ("A", "AB", "ABC"), ("Mug", "Mug_2", "Mug_3")])
def test_the_likeliest_name_is_that_of_scoring_all(model, asked, names):
    spec = ProgramSpec(skills=SKILLS, objects=names)
    state = ProgramAutomaton(spec).advance(ProgramAutomaton(spec).start(), "GoToObject(robot, '")
    prompt = f"{asked}GoToObject(robot, '"
    model.evaluate([], model.tokens(prompt))
    begun = NameBegun(0, state, model.decoded, model.logits().copy())
    word, tokens, chances = best_name(model, begun)
    words = [f"{name}'" for name in names]
    scores = every_score(SkillScorer(model), [prompt], words).values
    assert word == words[int(scores.argmax())]
    assert sum(chances) == pytest.approx(scores.max(), abs=0.05)
    assert b"".join(model.table.pieces[token] for token in tokens) == word.encode()


def test_who_wants_a_desk_does_not_get_a_desk_lamp(mini):
    model = LlamaModel(mini, options=LlamaOptions(threads=1))
    prompt = Prompt(
        stable="#areas\nnode_1 SideTable CoffeeTable\nnode_2 Bed DeskLamp\n", changing=ASKED
    )
    heard = []
    answer = model.complete(
        prompt, spec=ProgramSpec(skills=SKILLS, objects=ROOM), listen=heard.append
    )
    assert "PutObject(robot, 'CreditCard'" in answer.text
    assert not {"DeskLamp", "Dumbbell"} & {name for name in ROOM if f"'{name}'" in answer.text}
    assert "".join(one.text for one in heard) == answer.text
