"""Plans in JSON: what an automaton, grammars and a schema admit, and what models say under them."""

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.grammar_oracle import LlamaGrammar, is_valid
from support.hosted_server import NANO, chat, endpoint, plant_key, wire_server
from support.needs import need_models
from support.tiny import export_tiny

from karma.contracts import PlanSpec, Prompt
from karma.models.automaton import ProgramAutomaton
from karma.models.endpoint import Endpoint
from karma.models.grammars import plan_gbnf, plan_regex, plan_schema
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.models.session import Session
from karma.plugins.hosted.planner import open_planner

ACTIONS = ("find a Apple", "find a Fridge", *(f"open the Drawer_{n}" for n in range(2, 14)))
SPEC = PlanSpec(
    texts=("why", "words"), plan="plan", number="id", name="action", actions=ACTIONS,
    max_text=12, max_actions=3,
)  # fmt: skip
PROMPT = Prompt(stable="#areas\n", changing="#task put the apple in the fridge\n")
NAMED = {"why": "", "words": ""}


def said(*numbers, **texts):
    plan = [{"id": n, "action": ACTIONS[n] if 0 <= n < len(ACTIONS) else "x"} for n in numbers]
    return json.dumps({**NAMED, **texts, "plan": plan}, separators=(",", ":"))


def admits(text, spec=SPEC):
    automaton = ProgramAutomaton(spec)
    state = automaton.advance(automaton.start(), text)
    return state is not None and automaton.accepts(state)


LEGAL = (
    said(), said(0), said(13, 0, 0), said(1, why="because, so"), said(2, words="a{b}[c]:,~ !"),
)  # fmt: skip
ILLEGAL = (
    "", "{}", said(14), said(-1), said(0, 0, 0, 0), said(0, why="thirteen char"), said(0)[:-1],
    said(0) + "\n", said(0).replace("Apple", "Fridge"), said(0, why='a"b'), said(0, why="é"),
    said(0).replace(":0", ":00"), json.dumps({"plan": [], **NAMED}),
)  # fmt: skip


@pytest.mark.parametrize(("texts", "legal"), [(LEGAL, True), (ILLEGAL, False)])
def test_automaton_expression_and_grammar_admit_the_same_plans(texts, legal):
    whole = re.compile(plan_regex(SPEC))
    with LlamaGrammar(NANO, plan_gbnf(SPEC)) as grammar:
        for text in texts:
            assert admits(text) is legal, text
            assert bool(whole.fullmatch(text)) is legal, text
            assert grammar.accepts(text) is legal, text


def test_schema_admits_plans_of_listed_numbers_only():
    made = plan_schema(SPEC)
    assert all(is_valid(made, text) for text in LEGAL)
    for text in (said(14), said(-1), said(0, 0, 0, 0), said(0, why="thirteen char"), "{}"):
        assert not is_valid(made, text)


@given(data=st.data())
def test_automaton_any_walk_through_it_ends_in_a_plan_that_parses(data):
    automaton = ProgramAutomaton(SPEC)
    state, text = automaton.start(), b""
    while not automaton.accepts(state):
        coming = automaton.expected(state) or bytes(
            [data.draw(st.sampled_from(automaton.next_bytes(state)))]
        )
        text += coming
        state = automaton.advance(state, coming)
        assert state is not None
    found = json.loads(text)
    assert list(found) == ["why", "words", "plan"]
    assert all(len(found[key]) <= SPEC.max_text for key in SPEC.texts)
    assert len(found["plan"]) <= SPEC.max_actions
    assert all(ACTIONS[one["id"]] == one["action"] for one in found["plan"])
    assert automaton.next_bytes(state) == ()


def test_spec_without_text_or_with_one_action_is_admitted_alike():
    spec = PlanSpec(
        texts=("why",), plan="plan", number="id", name="a", actions=("x",), max_text=0,
        max_actions=1,
    )  # fmt: skip
    text = '{"why":"","plan":[{"id":0,"a":"x"}]}'
    assert admits(text, spec)
    assert re.fullmatch(plan_regex(spec), text)
    with LlamaGrammar(NANO, plan_gbnf(spec)) as grammar:
        assert grammar.accepts(text)
        assert not grammar.accepts(text.replace("]", ',{"id":0,"a":"x"}]'))


def test_spec_without_actions_is_refused():
    with pytest.raises(ValueError, match="no plan"):
        ProgramAutomaton(PlanSpec(texts=(), plan="p", number="n", name="a", actions=()))


# ----------------------------------------------------------------- models


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """A model of random weights, and the nano planner."""
    need_models("karma-nano")
    path = export_tiny(tmp_path_factory.mktemp("tiny") / "tiny.gguf")
    options = LlamaOptions(threads=1)
    found = [LlamaModel(one, options=options) for one in (path, NANO)]
    yield found
    for model in found:
        model.close()


@pytest.mark.model
def test_constrained_answers_of_any_weights_parse_and_name_listed_actions(models):
    draws = np.random.default_rng(0)
    lengths = set()
    for model in models:
        for seed in range(12):
            words = " ".join(map(str, draws.integers(1000, size=5)))
            prompt = Prompt(stable=PROMPT.stable, changing=f"#task {words}\n")
            answer = model.complete(
                prompt, spec=SPEC, max_tokens=300, temperature=1.5 * (seed % 3), seed=seed
            )
            assert answer.finish == "stop"
            assert answer.constrained is True
            assert admits(answer.text), answer.text
            lengths.add(len(json.loads(answer.text)["plan"]))
    assert len(lengths) > 1  # they do differ


@pytest.mark.model
def test_constrained_answer_is_the_same_twice_and_a_short_one_is_cut(models):
    for model in models:
        one, other = (model.complete(PROMPT, spec=SPEC, max_tokens=200) for _ in range(2))
        assert one.text == other.text
        cut = model.complete(PROMPT, spec=SPEC, max_tokens=5)
        assert (cut.finish, cut.completion_tokens) == ("length", 5)
        assert one.text.startswith(cut.text)


def test_beyond_training_lets_a_context_be_longer_and_needs_its_length(tmp_path):
    path = export_tiny(tmp_path / "tiny.gguf")
    said = {"threads": 1, "n_ctx": 6000}
    held = LlamaModel(path, options=LlamaOptions(**said))
    longer = LlamaModel(path, options=LlamaOptions(**said, beyond_training=True))
    assert (held.gguf.limit, longer.gguf.limit) == (4096, 6000)
    prompt = Prompt(stable="", changing="put the apple in the fridge\n" * 600)
    answer = longer.complete(prompt, spec=SPEC, max_tokens=100)
    assert answer.prompt_tokens > 4096
    assert admits(answer.text)
    for model in (held, longer):
        model.close()
    with pytest.raises(Exception, match="beyond_training = true needs n_ctx"):
        LlamaOptions(beyond_training=True)


# ----------------------------------------------------------------- hosted


def schema_in(body):
    return body["response_format"]["json_schema"]["schema"]


@pytest.mark.parametrize(
    ("dialect", "field"),
    [
        ("plain", lambda body: schema_in(body) == plan_schema(SPEC)),
        ("ollama", lambda body: schema_in(body) == plan_schema(SPEC)),
        ("sglang", lambda body: body["regex"] == plan_regex(SPEC)),
        ("vllm", lambda body: body["structured_outputs"] == {"grammar": plan_gbnf(SPEC)}),
        ("transformers", lambda body: not {"response_format", "grammar", "regex"} & set(body)),
    ],
)  # fmt: skip
def test_hosted_plans_are_asked_for_as_each_server_takes_it(monkeypatch, dialect, field):
    plant_key(monkeypatch)
    answers = iter((said(0, 1), said(99)))
    with wire_server(lambda *_: chat(next(answers))) as (url, seen):
        place = endpoint(url, model="m", dialect=dialect)
        model = open_planner(place, session=Session())
        held, broken = (model.complete(PROMPT, spec=SPEC) for _ in range(2))
    asked = next(body for path, body, _ in seen if path.endswith("completions"))
    assert field(asked)
    taken = dialect != "transformers"
    assert (held.text, held.constrained) == (said(0, 1), taken)
    assert broken.constrained is False
    assert isinstance(place, Endpoint)
