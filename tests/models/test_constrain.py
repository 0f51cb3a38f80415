"""Constrained decoding: what it admits parses, every program is admitted, choices are exact."""

import ast
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.random_programs import random_program

from karma.errors import ModelError
from karma.models.automaton import ProgramAutomaton, without_closing
from karma.models.llama.answer import TokenTable, choose_token, descending, gumbel
from karma.types.planning import REFUSAL_KINDS, ProgramSpec, Skill, SkillCall

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


def read(automaton, text):
    state = automaton.advance(automaton.start(), text)
    return "dead" if state is None else "whole" if automaton.accepts(state) else "alive"


@given(spec=SPECS, generator=SEEDS, data=st.data())
def test_random_program_is_a_member_and_its_prefixes_are_alive(spec, generator, data):
    automaton = ProgramAutomaton(spec)
    text = random_program(automaton, generator, data.draw(st.integers(1, spec.max_calls)))
    assert members(spec, text)
    for cut in range(len(text) + 1):
        found = read(automaton, text[:cut])
        assert found == ("whole" if cut and text[:cut].rstrip("\n")[-1:] == ")" else "alive")
    state = automaton.start()
    for character in text:  # and one character at a time leads to the same place
        state = automaton.advance(state, character)
    assert state == automaton.advance(automaton.start(), text)


@st.composite
def programs(draw, spec):
    """Programs built from the spec without the automaton."""
    lines = []
    for _ in range(draw(st.integers(1, spec.max_calls))):
        skill = draw(st.sampled_from(spec.skills))
        count = len(skill.arguments) - draw(st.integers(0, skill.optional))
        objects, positions = [], []
        for kind in skill.arguments[:count]:
            if kind == "object":
                objects.append(draw(st.sampled_from(spec.objects)))
            elif spec.positions:
                most = len(set(spec.positions))
                entries = st.sampled_from(spec.positions)
                positions = draw(st.lists(entries, min_size=1, max_size=most))
        if (
            "positions" in skill.arguments[: len(skill.arguments) - skill.optional]
            and not positions
        ):
            skill, objects = SKILLS[-1], []
        lines.append(str(SkillCall(skill=skill.name, objects=(*objects,), positions=(*positions,))))
    return "".join(f"{line}\n" for line in lines)


@given(data=st.data())
def test_every_program_of_the_spec_is_admitted(data):
    spec = data.draw(SPECS.filter(lambda s: SKILLS[-1] in s.skills))
    assert read(ProgramAutomaton(spec), data.draw(programs(spec))) == "whole"


@given(spec=SPECS, generator=SEEDS, data=st.data())
def test_mangled_program_is_accepted_only_if_still_a_member(spec, generator, data):
    automaton = ProgramAutomaton(spec)
    text = random_program(automaton, generator, data.draw(st.integers(1, spec.max_calls)))
    place = data.draw(st.integers(0, len(text) - 1))
    size = data.draw(st.integers(0, 3))
    new = data.draw(st.text(st.sampled_from("'\"[](), \n_ARobotxé1"), max_size=3))
    mangled = text[:place] + new + text[place + size :]
    assert (read(automaton, mangled) == "whole") == members(spec, mangled)


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
    assert read(ProgramAutomaton(spec), text) != "whole"
    assert read(ProgramAutomaton(spec), "Wait(robot)\n" * 3) == "whole"


@pytest.mark.parametrize("change", [
    {"objects": ("it's",)}, {"objects": ("a\nb",)}, {"objects": ("",)}, {"objects": ("a\\",)},
    {"objects": ("\ud800",)}, {"skills": (SKILLS[0], SKILLS[0])}, {"skills": ()},
    {"skills": SKILLS[:1], "objects": ()}, {"skills": SKILLS[3:4]}, {"max_calls": 0},
])  # fmt: skip
def test_spec_that_cannot_be_said_is_refused(change):
    spec = {"skills": SKILLS, "objects": ("Apple",)} | change
    with pytest.raises(ValueError, match=r"name|admits no program"):
        ProgramAutomaton(ProgramSpec(**spec))


# ------------------------------------------------------------------------------ tokens

PIECES = [bytes([b]) for b in range(256)] + [
    b"", b"", b"GoTo", b"Object", b"(robot", b", '", b"')\n", b"Apple", b"App", b"le|", b"')\nGo",
    b"\xc3\xa9\xc3", b"Go", b"PutObject(robot, '", b")\n", b"['", b"node_", b"', 'node_1", b"']",
]  # fmt: skip
TABLE = TokenTable(PIECES, [256])
TOKEN_SPEC = ProgramSpec(
    skills=SKILLS, objects=("Apple", "Apple|-1", "éé"), positions=("node_1", "node_2"), max_calls=3
)
AUTOMATON = ProgramAutomaton(TOKEN_SPEC)


def masked(state):
    """The tokens that may follow, by trying each."""
    after = [AUTOMATON.advance(state, piece, closing=True) for piece in TABLE.pieces]
    alive = [
        bool(piece) and one is not None for piece, one in zip(TABLE.pieces, after, strict=True)
    ]
    alive[256] = AUTOMATON.accepts(state)
    return np.array(alive)


@st.composite
def states(draw):
    generator = draw(SEEDS)
    text = random_program(AUTOMATON, generator, draw(st.integers(1, 3))).encode()
    return AUTOMATON.advance(AUTOMATON.start(), text[: draw(st.integers(0, len(text)))])


@pytest.mark.parametrize("end", ["", "\n", "\n\n", "\n```", "\n#"])
@pytest.mark.parametrize("program", ["Wait(robot)", "Wait(robot)\nGoToObject(robot, 'Apple')"])
def test_program_may_end_as_models_end_it_and_only_after_a_whole_line(program, end):
    assert read(AUTOMATON, program + end) == "whole"
    assert without_closing(program + end).rstrip("\n") == program
    for cut in range(1, len(program)):
        kept = program[:cut]
        whole = kept.endswith(")") and kept.rpartition("\n")[2] in program.split("\n")
        expected = "whole" if whole or kept.endswith("\n") else "alive"
        assert read(AUTOMATON, kept) == expected, kept
        if not whole:
            assert read(AUTOMATON, kept.rstrip("\n") + "\n```") != "whole" or kept.endswith("\n")


def test_token_that_closes_a_program_may_say_more_which_is_no_part_of_it():
    state = AUTOMATON.advance(AUTOMATON.start(), "Wait(robot)")
    table = TokenTable([b"\n\n# Instruction: wait\nWait", b"\nGo", b""], [2])
    token, after = choose_token(np.array([3, 2, 1], np.float32), AUTOMATON, state, table)
    assert (token, AUTOMATON.next_bytes(after), AUTOMATON.accepts(after)) == (0, (), True)
    assert without_closing("Wait(robot)\n\n# Instruction: wait\nWait") == "Wait(robot)\n"


@given(state=states(), generator=SEEDS, ties=st.booleans())
def test_chosen_token_equals_argmax_under_the_full_mask(state, generator, ties):
    logits = generator.normal(size=len(PIECES)).astype(np.float32) * 3
    if ties:
        logits = logits.round()
    mask = masked(state)
    token, after = choose_token(logits, AUTOMATON, state, TABLE)
    assert token == int(np.argmax(np.where(mask, logits, -np.inf)))
    then = None if token == 256 else AUTOMATON.advance(state, PIECES[token], closing=True)
    assert after == then


@pytest.mark.parametrize(
    "text", ["", "Wait(robot)\n", "GoToObject(robot, '", "Explore(robot, 'Apple', ["]
)
def test_sampled_tokens_follow_the_masked_softmax(text):
    generator = np.random.default_rng(5)
    state = AUTOMATON.advance(AUTOMATON.start(), text)
    logits = generator.normal(size=len(PIECES)).astype(np.float32)
    weights = np.where(masked(state), np.exp(logits / 0.7), 0)
    expected = weights / weights.sum()
    draws = 6000
    counts = np.zeros(len(PIECES))
    for _ in range(draws):
        noisy = gumbel(logits, 0.7, generator)
        counts[choose_token(noisy, AUTOMATON, state, TABLE).token] += 1
    assert np.all(counts[expected == 0] == 0)
    slack = 5 * np.sqrt(expected * (1 - expected) / draws)  # five standard deviations
    assert np.all(np.abs(counts / draws - expected) <= slack + 1e-12)


@given(size=st.integers(0, 3000), generator=SEEDS, coarse=st.booleans())
def test_descending_equals_a_full_stable_sort(size, generator, coarse):
    scores = (generator.normal(size=size) * 20).astype(np.float32)
    if coarse:  # many equal scores, also across the borders of chunks
        scores = scores.round()
    assert list(descending(scores)) == np.argsort(-scores, kind="stable").tolist()


def test_choice_impossible_or_not_a_number_is_a_model_error():
    start = AUTOMATON.start()
    with pytest.raises(ModelError, match="damaged"):
        choose_token(np.zeros(2, np.float32), AUTOMATON, start, TokenTable([b"x", b""], [1]))
    for bad in (np.nan, -np.inf):
        with pytest.raises(ModelError, match="damaged"):
            choose_token(np.full(len(PIECES), bad, np.float32), AUTOMATON, start, TABLE)


def test_admitted_text_parses_with_the_planner_s_own_parser():
    program = pytest.importorskip("karma.agent.planning.program")
    spec = ProgramSpec(
        skills=program.SKILLS, objects=("Apple|-00.47|+01.15|+00.48", "Fridge"),
        positions=("node_1", "node_2"),
    )  # fmt: skip
    automaton, generator = ProgramAutomaton(spec), np.random.default_rng(0)
    for lines in range(1, 41):
        text = random_program(automaton, generator, lines)
        calls = program.parse_program(text)
        assert "".join(f"{call}\n" for call in calls) == text
        assert re.fullmatch(r"(\w+\(robot, '[^'\n]+'(, ('[^']+'|\[[^]]+\]))?\)\n)+", text)
