"""GBNF and JSON schema admit exactly the programs and plans of the grammar.

Each is read by somebody else than who wrote it: llama.cpp's grammar sampler, and a schema reader of
the tests as well as llama.cpp's own conversion of schemas. KARMA_SAMPLE sets how many programs.
"""

import json
import os

import numpy as np
import pytest
from llama_cpp.llama_grammar import json_schema_to_gbnf
from support.grammar_oracle import LlamaGrammar, is_valid
from support.hosted_server import NANO
from support.needs import need_models
from support.plans import ILLEGAL, LEGAL, PLANS, plan
from support.random_programs import random_program

from karma.agent.planning.program import SKILLS, parse_program
from karma.agent.planning.recovery import refusal_in
from karma.errors import ProgramError
from karma.household.types import object_types
from karma.models.constraint import admits
from karma.plugins.hosted.grammars import (
    gbnf,
    program_text,
    schema,
)
from karma.types.planning import REFUSAL_KINDS, ProgramSpec

SAMPLES = int(os.environ.get("KARMA_SAMPLE", "2000"))
NODES = tuple(f"node_{number}" for number in range(1, 13))
SPEC = ProgramSpec(
    skills=SKILLS,
    objects=(*sorted(object_types()), "Mug_2"),
    positions=NODES,
    max_calls=6,
    refusals=REFUSAL_KINDS,
)
LETTERS = "abNS(),'[] \n_2"


def program_json(calls):
    """The JSON answer that stands for calls with named positions."""
    said = []
    for call in calls:
        names = [("object" if n == 0 else f"object_{n + 1}", o) for n, o in enumerate(call.objects)]
        positions = {"positions": list(call.positions)} if call.positions else {}
        said.append({"skill": call.skill, **dict(names), **positions})
    return json.dumps({"program": said}, ensure_ascii=False)


def mutated(text, generator):
    """A near miss, or by chance another program: one edit, line or name."""
    lines = text.splitlines(keepends=True)
    place, kind = int(generator.integers(len(text))), int(generator.integers(7))
    letter = LETTERS[int(generator.integers(len(LETTERS)))]
    if kind == 0:
        return text[:place] + text[place + 1 :]
    if kind == 1:
        return text[:place] + letter + text[place:]
    if kind == 2:
        return text[:place] + letter + text[place + 1 :]
    if kind == 3:
        return text * 2
    if kind == 4:
        return text[:place]
    if kind == 5:
        return text.replace("')\n", "', 'Sink')\n", 1)
    return "".join([lines[-1], *lines]).replace("GoToObject", "PutObject", 1)


@pytest.fixture(scope="module")
def samples():
    """Programs of one to seven lines, half of them changed."""
    generator = np.random.default_rng(12)
    found = []
    for number in range(SAMPLES):
        lines = 1 + int(generator.integers(SPEC.max_calls))
        text = random_program(SPEC, generator, lines)
        end = ("\n", "", "\n\n", "\n```", "\n#")[number % 5]
        text = text if text.startswith("refuse") else text.rstrip("\n") + end
        found.append(text if number % 2 else mutated(text, generator))
    return found


@pytest.fixture(scope="module")
def admitted(samples):
    grammar = SPEC.grammar
    found = [admits(grammar, text) for text in samples]
    assert SAMPLES // 2 <= sum(found) < SAMPLES * 0.7  # both kinds are there
    assert sum(text.startswith("refuse") for text in samples) > SAMPLES // 5
    return found


@pytest.mark.model
def test_gbnf_admits_exactly_the_programs_of_the_spec(samples, admitted):
    need_models("karma-nano")
    with LlamaGrammar(NANO, gbnf(SPEC.grammar)) as grammar:
        assert [grammar.accepts(text) for text in samples] == admitted


def ended(text):
    """A text as we write programs: its end, of those that models write, is one newline."""
    end = next((end for end in ("\n\n", "\n```", "\n#", "\n") if text.endswith(end)), "")
    return text.removesuffix(end) + "\n"


def as_json(text):
    """The JSON of a text's calls; None where it is no program in the form that we write."""
    if (found := refusal_in(text)) is not None:
        refused = found.refused
        exact = text in (f"{refused}", f"{refused}\n")
        return json.dumps({"program": {"refuse": refused.kind}}) if exact else None
    text = ended(text)
    try:
        calls = parse_program(text)
    except ProgramError:
        return None
    return program_json(calls) if "".join(f"{call}\n" for call in calls) == text else None


def test_schema_admits_exactly_the_programs_of_the_spec_without_loss(samples, admitted):
    made, found = schema(SPEC), []
    for text in samples:
        answer = as_json(text)
        if answer is not None and text:
            assert program_text(answer) == ended(text)
        found.append(answer is not None and is_valid(made, answer))
    assert found == admitted


@pytest.mark.model
def test_schema_as_llama_cpp_reads_it_admits_the_same(samples, admitted):
    need_models("karma-nano")
    few, answers = slice(0, 300), [as_json(text) for text in samples[:300]]
    with LlamaGrammar(NANO, json_schema_to_gbnf(json.dumps(schema(SPEC)))) as grammar:
        found = [answer is not None and grammar.accepts(answer) for answer in answers]
    assert found == admitted[few]


@pytest.mark.parametrize("most", [1, 40])
def test_number_of_calls_is_bounded_in_every_grammar(most):
    spec = ProgramSpec(skills=SKILLS, objects=("Mug",), max_calls=most)
    line = "GoToObject(robot, 'Mug')\n"
    made = schema(spec)
    with LlamaGrammar(NANO, gbnf(spec.grammar)) as grammar:
        for calls, legal in ((0, False), (1, True), (most, True), (most + 1, False)):
            text = line * calls
            assert grammar.accepts(text) is legal
            assert is_valid(made, program_json(parse_program(text))) is legal


def test_signs_in_names_stand_for_themselves():
    names = ('Apple|-00.47|+01.15|(2) "x" [b] {c}', "Crème", "a.c", "a^b$")
    spec = ProgramSpec(skills=SKILLS[:1], objects=names, max_calls=1)
    made = schema(spec)
    with LlamaGrammar(NANO, gbnf(spec.grammar)) as grammar:
        for name in names:
            answer = json.dumps({"program": [{"skill": "GoToObject", "object": name}]})
            assert grammar.accepts(f"GoToObject(robot, '{name}')\n")
            assert program_text(answer) == f"GoToObject(robot, '{name}')\n"
            assert is_valid(made, answer)
        assert not grammar.accepts("GoToObject(robot, 'abc')\n")


@pytest.mark.parametrize(
    "answer",
    [
        "", "[]", "{", '{"program": 1}', '{"program": ["x"]}', '{"program": [{}]}',
        '{"program": [{"skill": 1}]}', '{"program": [{"skill": "Go", "object": 2}]}',
        '{"program": [{"skill": "Go", "what": "Mug"}]}', '{"program": [], "more": 1}',
        '{"program": [{"skill": "Go", "object_2": "Mug"}]}',
        '{"program": [{"skill": "Go", "positions": "node_1"}]}',
        '{"program": [{"skill": "Go", "positions": []}]}', '{"refuse": "deed"}',
        '{"program": {"refuse": "deed"}, "a": 1}', '{"program": {"refuse": "mood"}}',
        '{"program": {"refuse": ["deed"]}}',
    ],
)  # fmt: skip
def test_json_that_is_no_program_is_told_apart_from_an_empty_one(answer):
    assert program_text(answer) is None
    assert program_text('{"program": []}') == ""


@pytest.mark.parametrize(("texts", "legal"), [(LEGAL, True), (ILLEGAL, False)])
def test_grammar_admits_the_plans_of_the_spec(texts, legal):
    with LlamaGrammar(NANO, gbnf(PLANS.grammar)) as grammar:
        for text in texts:
            assert grammar.accepts(text) is legal, text


def test_schema_admits_plans_of_listed_numbers_only():
    made = PLANS.schema
    assert all(is_valid(made, text) for text in LEGAL)
    for text in (plan(14), plan(-1), plan(0, 0, 0, 0), plan(0, why="thirteen char"), "{}"):
        assert not is_valid(made, text)
