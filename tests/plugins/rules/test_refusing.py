"""What people are told of a refused request, and refusals by the table of types."""

import msgspec
import pytest

from karma.agent.planning.planner import Planner
from karma.agent.planning.refused import sentence, with_words
from karma.journal.entries import Answer
from karma.models.scripted import ScriptedModel
from karma.types.completion import Decoding
from karma.types.planning import REFUSAL_KINDS, Hint, Meaning, PlanRequest, RefusedRequest

SOFA = "GoToObject(robot, 'Sofa')\nSliceObject(robot, 'Sofa')\n"
BED = "SliceObject(robot, 'Bed')\n"
APPLE = "GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
FULL_HAND = "PickupObject(robot, 'Apple')\nPutObject(robot, 'Pear', 'Sink')\n"
FETCH = Hint(phrase="fetch up", meanings=(Meaning(name="hold", similarity=0.3),))
HAMMER = Hint(phrase="hammer", meanings=(Meaning(name="Knife", similarity=0.4),))
TUMBLER = Hint(phrase="tumbler", meanings=(Meaning(name="Cup", similarity=0.8),))


@pytest.mark.parametrize("kind", REFUSAL_KINDS)
def test_sentence_of_every_kind_is_one_and_names_the_words_there_are(kind):
    alone = sentence(RefusedRequest(kind=kind))
    told = sentence(RefusedRequest(kind=kind, words=("green hammer",)))
    for text in (alone, told):
        assert text[0].isupper() and text.endswith(".") and "{" not in text
    assert ("green hammer" in told) == (kind not in ("language", "negated"))


def test_words_of_a_refusal_are_the_phrases_without_a_near_meaning():
    request = PlanRequest(instruction="x", hints=(HAMMER, TUMBLER, FETCH))
    words = {kind: with_words(RefusedRequest(kind=kind), request).words for kind in REFUSAL_KINDS}
    assert words["thing"] == words["unclear"] == ("hammer",)
    assert words["deed"] == ("fetch up",)
    assert with_words(RefusedRequest(kind="thing"), PlanRequest(instruction="x")).words == ()


def plans(answers, **decoding):
    model = ScriptedModel(answers)
    facts = PlanRequest(instruction="do it")
    return list(Planner(model, "compact", Decoding(**decoding)).plan(facts))


def test_request_is_refused_where_every_answer_ends_in_what_no_type_allows():
    *before, last = plans([SOFA] * 4, refusing=True)
    assert [plan.refused for plan in before] == [None] * 3
    assert last.refused == RefusedRequest(
        kind="impossible", by="inspector", words=("Sofa cannot be sliced",)
    )
    assert (last.calls, last.error, last.failure) == ((), "", None)
    assert sentence(last.refused) == "That cannot be done: Sofa cannot be sliced."


@pytest.mark.parametrize(
    ("answers", "decoding"),
    [
        ([SOFA] * 4, {"refusing": False}),  # it has not learnt to
        ([SOFA, BED, SOFA, BED], {"refusing": True}),  # not the same each time
        ([SOFA, SOFA, SOFA, APPLE], {"refusing": True}),  # found something at last
        ([FULL_HAND] * 4, {"refusing": True}),  # another order of lines would help
        ([SOFA], {"refusing": True, "attempts": 1}),  # said once only
        ([SOFA] * 4, {"refusing": True, "inspected": False}),
    ],
)
def test_request_is_tried_where_answers_are_not_all_equally_impossible(answers, decoding):
    last = plans(answers, **decoding)[-1]
    assert last.refused is None
    assert last.calls


def test_answer_of_0_3_0_that_was_refused_by_doubt_is_still_read():
    line = (
        b'{"program": "x", "error": "", "finish": "stop", "prompt_tokens": 1, "doubt": 0.9,'
        b' "completion_tokens": 1, "refused": {"kind": "thing", "by": "doubt", "words": []}}'
    )
    assert msgspec.json.decode(line, type=Answer).refused.by == "doubt"
