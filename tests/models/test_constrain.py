"""Constrained decoding: what it admits parses, every program is admitted, choices are exact."""

import ast
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_programs import random_program

from karma.agent.planning.program import SKILLS as LISTING_2
from karma.agent.planning.program import parse_program
from karma.errors import ModelError
from karma.models.constraint import Constraint, admits, begins
from karma.models.llama.answer import gumbel
from karma.types.grammars import CLOSINGS, without_closing
from karma.types.planning import REFUSAL_KINDS, Grammar, ProgramSpec, Skill, SkillCall

SKILLS = (
    Skill(name="GoToObject", arguments=("object",)),
    Skill(name="PutObject", arguments=("object", "object"), optional=1),
    Skill(name="Explore", arguments=("object", "positions"), optional=1),
    Skill(name="Scan", arguments=("positions",)),
    Skill(name="Go", arguments=("object",)),
    Skill(name="Wait", arguments=()),
)
NAMES = st.one_of(
    st.sampled_from(["Apple", "Apple|-00.47|+01.15|+00.48", "AppleSliced", "Mug, big", "A", "AB"]),
    st.text(st.characters(categories=["L", "N", "P", "S", "Zs"], exclude_characters="'\\"),
            min_size=1, max_size=12).filter(str.isprintable),
)  # fmt: skip
SPECS = st.builds(
    ProgramSpec,
    skills=st.lists(st.sampled_from(SKILLS), min_size=1, unique=True).map(
        lambda skills: (*skills, SKILLS[-1])[: len(set([*skills, SKILLS[-1]]))]
    ),
    objects=st.lists(NAMES, min_size=1, max_size=6).map(tuple),
    positions=st.lists(st.sampled_from(["node_1", "node_2", "node_11"]), max_size=3).map(tuple),
    max_calls=st.integers(1, 5),
    refusals=st.lists(st.sampled_from(REFUSAL_KINDS), max_size=3).map(tuple),
)
SEEDS = st.integers(0, 2**32).map(np.random.default_rng)


def members(spec, text):
    """Independent reading: is `text` a program of the spec, or a refusal that it admits?"""
    if any(text in (f"refuse('{kind}')", f"refuse('{kind}')\n") for kind in spec.refusals):
        return True
    for end in ("\n\n", "\n```", "\n#", "\n"):
        if text.endswith(end):
            text = text.removesuffix(end)
            break
    lines = text.split("\n")
    return 1 <= len(lines) <= spec.max_calls and all(is_line(spec, line) for line in lines)


def is_line(spec, line):
    try:
        call = ast.parse(line).body[0].value
        name, (robot, *nodes) = call.func.id, call.args
        values = [ast.literal_eval(node) for node in nodes]
    except (SyntaxError, ValueError, AttributeError, IndexError):
        return False
    skill = next((s for s in spec.skills if s.name == name), None)
    if skill is None or robot.id != "robot" or call.keywords:
        return False
    most = len(skill.arguments)
    if not most - skill.optional <= len(values) <= most:
        return False
    for kind, value in zip(skill.arguments, values, strict=False):
        if kind == "object" and value not in spec.objects:
            return False
        if kind == "positions" and not (
            0 < len(value) <= len(set(spec.positions)) and set(value) <= set(spec.positions)
        ):
            return False
    texts = tuple(v for v in values if isinstance(v, str))
    lists = tuple(p for v in values if isinstance(v, list) for p in v)
    return str(SkillCall(skill=name, objects=texts, positions=lists)) == line


def read(spec, text):
    whole = admits(spec.grammar, text)
    return "whole" if whole else "alive" if begins(spec.grammar, text) else "dead"


@given(spec=SPECS, generator=SEEDS, data=st.data())
@settings(max_examples=50, deadline=None)
def test_random_program_is_a_member_and_its_prefixes_are_alive(spec, generator, data):
    text = random_program(spec, generator, data.draw(st.integers(1, spec.max_calls)))
    assert members(spec, text)
    for cut in {0, len(text), *data.draw(st.lists(st.integers(0, len(text)), max_size=8))}:
        whole = cut and text[:cut].rstrip("\n")[-1:] == ")"
        assert read(spec, text[:cut]) == ("whole" if whole else "alive")


@given(spec=SPECS, generator=SEEDS, data=st.data())
def test_mangled_program_is_accepted_only_if_still_a_member(spec, generator, data):
    text = random_program(spec, generator, data.draw(st.integers(1, spec.max_calls)))
    place = data.draw(st.integers(0, len(text) - 1))
    size = data.draw(st.integers(0, 3))
    new = data.draw(st.text(st.sampled_from("'\"[](), \n_ARobotxé1"), max_size=3))
    mangled = text[:place] + new + text[place + size :]
    assert (read(spec, mangled) == "whole") == members(spec, mangled)


@pytest.mark.parametrize("text", [
    "", "\n", "GoToObject(robot, 'Pear')\n", "GoToObject(robot,'Apple')\n",
    "Explore(robot, 'Apple', [])\n",
    "Explore(robot, 'Apple', ['node_1',])\n", "Explore(robot, ['node_1'])\n", "GoToObject(robot)\n",
    "GoToObject(robot, 'Apple')#", "GoToObject(robot, 'Apple')\n``", "# hm\nWait(robot)\n",
    "Wait(robot", "wait(robot)\n", "Wait(robot)\n\n\n", "Wait(robot)\n#\nWait(robot)\n",
    "Wait(robot)\n" * 4, "refuse('deed')\n",
])  # fmt: skip
def test_text_outside_the_language_is_not_accepted(text):
    spec = ProgramSpec(skills=SKILLS, objects=("Apple",), positions=("node_1",), max_calls=3)
    assert read(spec, text) != "whole"
    assert read(spec, "Wait(robot)\n" * 3) == "whole"


@pytest.mark.parametrize("change", [
    {"objects": ("it's",)}, {"objects": ("a\nb",)}, {"objects": ("",)}, {"objects": ("a\\",)},
    {"objects": ("\ud800",)}, {"skills": (SKILLS[0], SKILLS[0])}, {"skills": ()},
    {"skills": SKILLS[:1], "objects": ()}, {"skills": SKILLS[3:4]}, {"max_calls": 0},
])  # fmt: skip
def test_spec_that_cannot_be_said_is_refused(change):
    spec = {"skills": SKILLS, "objects": ("Apple",)} | change
    with pytest.raises(ValueError, match=r"name|admits no program"):
        _ = ProgramSpec(**spec).grammar


# ------------------------------------------------------------------------------ tokens

PIECES = [bytes([b]) for b in range(256)] + [
    b"", b"", b"GoTo", b"Object", b"(robot", b", '", b"')\n", b"Apple", b"App", b"le|", b"')\nGo",
    b"\xc3\xa9\xc3", b"Go", b"PutObject(robot, '", b")\n", b"['", b"node_", b"', 'node_1", b"']",
]  # fmt: skip
END = 256
SPEC = ProgramSpec(
    skills=SKILLS, objects=("Apple", "Apple|-1", "éé"), positions=("node_1", "node_2"), max_calls=3
)


class _Words:
    """A vocabulary as llguidance takes it."""

    tokens, eos_token_id, bos_token_id, special_token_ids = PIECES, END, None, ()

    def __call__(self, text):
        return list(text)


@pytest.fixture(scope="module")
def tokenizer():
    from llguidance import LLTokenizer, TokenizerWrapper

    return LLTokenizer(TokenizerWrapper(_Words()))


def held(tokenizer, text, grammar=SPEC.grammar):
    """A constraint behind a text of single letters."""
    made = Constraint(tokenizer, grammar)
    for byte in text.encode():
        made.take(byte)
    return made


def masked(text):
    """The tokens that may follow, by trying each."""
    said, grammar = text.encode(), SPEC.grammar
    alive = [bool(piece) and begins(grammar, said + piece) for piece in PIECES]
    alive[END] = admits(grammar, text)
    return np.array(alive)


@pytest.mark.parametrize("end", ["", "\n", *(f"\n{closing}" for closing in CLOSINGS)])
@pytest.mark.parametrize("program", ["Wait(robot)", "Wait(robot)\nGoToObject(robot, 'Apple')"])
def test_program_may_end_as_models_end_it_and_only_after_a_whole_line(program, end):
    assert read(SPEC, program + end) == "whole"
    assert without_closing(program + end).rstrip("\n") == program
    for cut in range(1, len(program)):
        kept = program[:cut]
        whole = kept.endswith((")", "\n"))
        assert read(SPEC, kept) == ("whole" if whole else "alive"), kept


TEXTS = ["", "Wait(robot)", "Wait(robot)\n", "GoToObject(robot, '", "Explore(robot, 'Apple', ["]


@pytest.mark.parametrize("text", TEXTS)
def test_chosen_token_equals_argmax_under_the_full_mask(tokenizer, text):
    generator, mask = np.random.default_rng(1), masked(text)
    for ties in (False, True):
        for _ in range(20):
            logits = generator.normal(size=len(PIECES)).astype(np.float32) * 3
            logits = logits.round() if ties else logits
            token = held(tokenizer, text).choose(logits)
            assert token == int(np.argmax(np.where(mask, logits, -np.inf)))


@pytest.mark.parametrize("text", TEXTS)
def test_sampled_tokens_follow_the_masked_softmax(tokenizer, text):
    generator = np.random.default_rng(5)
    logits = generator.normal(size=len(PIECES)).astype(np.float32)
    weights = np.where(masked(text), np.exp(logits / 0.7), 0)
    expected = weights / weights.sum()
    draws, made = 3000, held(tokenizer, text)
    counts = np.zeros(len(PIECES))
    for _ in range(draws):
        counts[made.choose(gumbel(logits, 0.7, generator))] += 1
    assert np.all(counts[expected == 0] == 0)
    slack = 5 * np.sqrt(expected * (1 - expected) / draws)  # five standard deviations
    assert np.all(np.abs(counts / draws - expected) <= slack + 1e-12)


def test_an_answer_has_ended_where_nothing_may_follow(tokenizer):
    refusing = ProgramSpec(skills=SKILLS, objects=("Mug",), refusals=("deed",), max_calls=1)
    assert not held(tokenizer, "Wait(robot)", refusing.grammar).has_ended
    for text in ("Wait(robot)\n#", "refuse('deed')\n"):
        assert held(tokenizer, text, refusing.grammar).has_ended


def test_choice_impossible_or_not_a_number_is_a_model_error(tokenizer):
    for bad in (np.nan, -np.inf):
        with pytest.raises(ModelError, match="damaged"):
            held(tokenizer, "").choose(np.full(len(PIECES), bad, np.float32))
    scores = np.full(len(PIECES), -np.inf, np.float32)
    scores[ord("x")] = 0
    with pytest.raises(ModelError, match="damaged"):
        held(tokenizer, "").choose(scores)
    with pytest.raises(ModelError, match="the grammar cannot be used"):
        Constraint(tokenizer, "start: missing")


def test_any_grammar_will_do(tokenizer):
    tools = Grammar(grammar='start: line ("\\n" line){0,2} "\\n"?\n'
                            'line: "go(" NAME ")" | "done(\\"" TEXT? "\\")"\n'
                            'NAME: "Apple" | "Mug"\nTEXT: /[^"\\\\\\n]{1,9}/')  # fmt: skip
    for text in ("go(Apple)", "go(Mug)\n", 'go(Mug)\ndone("It is é")', 'done("")'):
        assert admits(tools.grammar, text), text
    for text in ("go(Pan)", "go(Mug)\n\n", 'done("\n")', "go(Mug)\n" * 4):
        assert not admits(tools.grammar, text), text


def test_admitted_text_parses_with_the_planner_s_own_parser():
    spec = ProgramSpec(
        skills=LISTING_2, objects=("Apple|-00.47|+01.15|+00.48", "Fridge"),
        positions=("node_1", "node_2"),
    )  # fmt: skip
    generator = np.random.default_rng(0)
    for lines in range(1, 41):
        text = random_program(spec, generator, lines)
        assert admits(spec.grammar, text)
        assert "".join(f"{call}\n" for call in parse_program(text)) == text
        assert re.fullmatch(r"(\w+\(robot, '[^'\n]+'(, ('[^']+'|\[[^]]+\]))?\)\n)+", text)
