"""The family table of docs/models.md: each cell is what made models of that family really do."""

import os
from dataclasses import replace
from functools import partial

import pytest
from support import tiny

from karma.agent.planning.planner import program_spec
from karma.agent.planning.program import parse_program
from karma.agent.planning.prompt import render, skills_of
from karma.models.constraint import admits, begins
from karma.testing import FAMILIES, Size, make_planner
from karma.types.memory import Area, MemoryUnit
from karma.types.planning import PlanRequest, Prompt

PROGRAMS = int(os.environ.get("KARMA_PROGRAMS", "60"))  # drawn of each family
REQUEST = PlanRequest(
    instruction="Put the clean apple in the fridge",
    areas=(
        Area(name="node_1", position_m=(1.0, 0.9, 2.0), contains=("Fridge", "CounterTop")),
        Area(name="node_2", position_m=(3.0, 0.9, 2.0), contains=("Sink", "Microwave")),
    ),
    graph_text="node_1: Fridge, CounterTop\nnode_2: Sink, Microwave",
    units=(
        MemoryUnit(object_id="Apple|1", object_type="Apple", position_m=(1.0, 1.0, 2.0),
                   states=("cleaned",), place_id="CounterTop|1", handled=True),
    ),
)  # fmt: skip
SKILLS = skills_of("full")
RENDERED = render("full", REQUEST)
LONG = program_spec(REQUEST, RENDERED.names, SKILLS)
SHORT, LONGER = (replace(LONG, max_calls=count) for count in (1, 5))


opened = partial(tiny.opened, chat=True)


@pytest.fixture(scope="module", params=FAMILIES)
def family(request):
    return FAMILIES[request.param]


@pytest.fixture(scope="module")
def planner(family, tmp_path_factory):
    folder = tmp_path_factory.mktemp("families")
    layers = 2 if family.name in ("gemma3", "lfm2") else 1  # one of each of its kinds
    return make_planner(folder / f"{family.name}.gguf", family.name, size=Size(layers=layers))


@pytest.fixture(scope="module")
def model(planner):
    made = opened(planner)
    yield made
    made.close()


# ----------------------------------------------------------------- the columns


# ----------------------------------------------------------------- programs and lists


def test_every_program_that_is_drawn_is_legal(model):
    legal, texts = 0, set()
    for seed in range(PROGRAMS):
        spec = LONGER if seed % 20 == 0 else SHORT
        found = model.complete(RENDERED.prompt, spec=spec, temperature=1.0, seed=seed)
        calls = parse_program(found.text, SKILLS)
        ended = found.finish == "stop" and admits(LONGER.grammar, found.text)
        stopped = found.finish == "cycle" and begins(
            LONGER.grammar, found.text
        )  # legal as far as it goes
        legal += (ended or stopped) and 1 <= len(calls) <= spec.max_calls
        texts.add(found.text)
    assert len(texts) > PROGRAMS / 8  # they are drawn, not one and the same
    assert legal == PROGRAMS


# ----------------------------------------------------------------- prompts


def test_full_prompt_goes_whole_through_the_family_s_template_cut_where_it_changes(model, family):
    before, after = model._template.halves(RENDERED.prompt)
    assert RENDERED.prompt.stable.strip() in before
    assert after.startswith(RENDERED.prompt.changing)
    for text in (before, after.removeprefix(RENDERED.prompt.changing)):
        tokens = model.gguf.tokens(text, special=True)
        for tag in (tag for tag in (*family.control, *family.added) if tag in text):
            (token,) = model.gguf.tokens(tag, special=True)  # one token, not its letters
            assert token in tokens


def test_warm_answer_of_every_family_equals_the_cold_one_to_the_bit(model, planner):
    options = {"spec": SHORT, "temperature": 1.0, "seed": 7}
    warm = [model.complete(RENDERED.prompt, **options) for _ in range(2)][-1]
    bits = model.gguf.logits().tobytes()
    fresh = opened(planner)
    assert fresh.complete(RENDERED.prompt, **options).text == warm.text
    assert fresh.gguf.logits().tobytes() == bits
    assert warm.state == ("kept" if model.gguf._can_rewind else "evaluated")
    fresh.close()


# ----------------------------------------------------------------- thoughts


THINKERS = [name for name in FAMILIES if FAMILIES[name].added]
SHORT_PROMPT = Prompt(stable="You are a robot.\n", changing="Put the apple away.\n")


@pytest.fixture(scope="module", params=THINKERS)
def thinker(request, tmp_path_factory):
    return make_planner(tmp_path_factory.mktemp("thinkers") / "x.gguf", request.param)


def said_after(model, prompt):
    """All that stands behind the prompt's own text in the model's cache, tags included."""
    llama = model.gguf.llama
    text = llama.detokenize(llama.input_ids[: llama.n_tokens].tolist(), special=True)
    return text.decode(errors="replace").rpartition(prompt.changing)[2]


def test_thinking_off_leaves_the_thought_empty_and_closed(thinker):
    model = opened(thinker)
    found = model.complete(SHORT_PROMPT, spec=SHORT)
    behind = said_after(model, SHORT_PROMPT)
    assert behind.startswith("<|im_end|>\n<|im_start|>assistant\n<think>\n\n</think>\n\n")
    assert found.reasoning == ""
    assert parse_program(found.text, SKILLS)


@pytest.mark.parametrize("budget", [0, 1, 30])
def test_a_thought_beyond_its_budget_is_closed_and_the_grammar_holds_behind_it(thinker, budget):
    model = opened(thinker, thinking="on", thinking_tokens=budget)
    for seed in range(5):
        found = model.complete(SHORT_PROMPT, spec=SHORT, temperature=1.0, seed=seed, max_tokens=90)
        thought, closing, program = said_after(model, SHORT_PROMPT).partition("\n</think>\n\n")
        assert closing and thought.startswith("<|im_end|>\n<|im_start|>assistant\n<think>\n")
        assert found.text.startswith(program.rstrip("`"))  # the last token is never decoded
        assert parse_program(found.text, SKILLS)
        assert bool(found.reasoning) <= (budget > 0)
        assert "</think>" not in found.reasoning
        assert found.completion_tokens <= budget + 90


def test_a_thought_that_the_model_closes_itself_ends_there(thinker):
    model = opened(thinker, thinking="on", thinking_tokens=6000)
    found = model.complete(SHORT_PROMPT, spec=SHORT, temperature=1.5, seed=1, max_tokens=90)
    assert 10 < found.completion_tokens < 5900
    assert said_after(model, SHORT_PROMPT).count("</think>\n\n") == 1
    assert parse_program(found.text, SKILLS)
