"""What a request was understood as is said before anything is done, refusals with a question."""

from dataclasses import replace

import pytest
from support.talking import STORE, TAKE, agent_saying

from karma import registry
from karma.models.scripted import ScriptedModel
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.understanding import Understanding, question, understood
from karma.types.completion import Certainty
from karma.types.events import Plan, SkillResult
from karma.types.planning import REFUSAL_KINDS, RefusedRequest

HERE = ("Bottle", "Bowl", "CounterTop", "Fridge", "Mug", "Plate", "Toaster")


class Sure(ScriptedModel):
    """Says its script, and how sure it is."""

    def complete(self, prompt, **options):
        told = Certainty(mean_logprob=-0.01, least_logprob=-0.2, refusing=0.1)
        return replace(super().complete(prompt, **options), certainty=told)


@pytest.fixture(scope="module")
def lexicon():
    return Lexicon(registry.load("embedders", "minilm")())


def moments(agent, text):
    return list(agent.doing(text))


def test_understanding_comes_before_the_first_action_and_says_things_places_deeds(tmp_path):
    seen = moments(agent_saying(tmp_path, [STORE]), "put the apple in the fridge")
    kinds = [type(moment) for moment in seen]
    assert kinds.index(Understanding) < kinds.index(SkillResult)
    told = seen[kinds.index(Understanding)]
    assert [str(one) for one in told.meant] == [
        "apple → Apple, to be looked for",
        "fridge → Fridge",
    ]
    assert told.deeds == ("take the apple", "open the fridge", "put the apple in the fridge",
                          "close the fridge")  # fmt: skip
    assert told.sure == ""  # a planner that is told what to say has no certainty


def test_place_of_a_thing_is_where_it_is_remembered(tmp_path):
    agent = agent_saying(tmp_path, [STORE, TAKE])
    agent.do("put the apple in the fridge")
    told = next(m for m in agent.doing("take the apple") if isinstance(m, Understanding))
    assert str(told.meant[0]) == "apple → Apple in the fridge"


@pytest.mark.parametrize(
    ("text", "program", "meant", "unnamed", "forbidden"),
    [
        ("any beer?", "ToggleOn(robot, 'Toaster')\n", "beer → nothing that I would use",
         ("toaster",), ()),
        ("put it in the fridge", STORE, "it → Apple, to be looked for", (), ()),
        ("don't put the apple in the fridge", STORE, "fridge → Fridge", (), ("put",)),
    ],
)  # fmt: skip
def test_phrases_of_a_text_are_matched_to_the_objects_of_its_program(
    text, program, meant, unnamed, forbidden, tmp_path, lexicon
):
    agent = agent_saying(tmp_path, [program], assistant="direct")
    plan = next(one for one in agent.doing(text) if isinstance(one, Plan))
    told = understood(text, plan, lambda name: None, lexicon, HERE)
    assert meant in map(str, told.meant)
    assert (told.unnamed, told.forbidden) == (unnamed, forbidden)


def test_several_things_stand_for_one_phrase(lexicon):
    near = lexicon.likeness("dirty dishes", ["Plate", "Bowl", "Laptop"])
    assert min(near["Plate"], near["Bowl"]) > near["Laptop"]


def test_sureness_of_an_answer_says_that_it_is_not_calibrated(tmp_path):
    own = agent_saying(tmp_path, [], model=Sure([TAKE])).do("take the apple")
    assert own.parts[0].understood[0].sure.endswith("(not calibrated)")


def test_refusal_does_nothing_and_asks(tmp_path):
    agent = agent_saying(tmp_path, ["refuse('thing')\n"])
    before = agent._world.last_event
    reply = agent.do("bring me the unicorn")
    assert reply.status == "refused" and not reply.checks
    told = reply.parts[0].understood[0]
    assert told.refused == "I know of no 'unicorn' in a home."
    assert told.question
    assert agent._world.last_event.metadata["objects"] == before.metadata["objects"]


@pytest.mark.parametrize("kind", REFUSAL_KINDS)
def test_every_refusal_has_a_question_or_a_suggestion(kind, lexicon):
    said = question(RefusedRequest(kind=kind), "hand me the flask", lexicon, HERE)
    assert said.endswith(("?", "."))
    without = question(RefusedRequest(kind=kind), "hand me the flask", Lexicon(None), HERE)
    assert without


def test_nearest_thing_that_is_here_is_suggested(lexicon):
    said = question(RefusedRequest(kind="thing", words=("flask",)), "the flask", lexicon, HERE)
    assert "the bottle" in said
    assert "fridge" not in said


def test_nearest_deed_is_suggested(lexicon):
    said = question(RefusedRequest(kind="deed"), "sterilise the mug", lexicon, HERE)
    assert "wash" in said
