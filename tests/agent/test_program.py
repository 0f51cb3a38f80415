"""The planner's text: what parses, what is refused, and that nothing else ever happens."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.agent.planning.program import MAX_LINES, MAX_NAME, SKILLS, parse_program
from karma.errors import ProgramError
from karma.types.planning import SkillCall

NAMES = st.text("ABCabc019|+-._ ", min_size=1, max_size=MAX_NAME).map(str.strip).filter(bool)
METRES = st.floats(-1000, 1000, allow_nan=False)
POINTS = st.tuples(METRES, METRES, METRES)


@st.composite
def calls(draw):
    skill = draw(st.sampled_from(SKILLS))
    kept = len(skill.arguments) - draw(st.integers(0, skill.optional))
    kinds = skill.arguments[:kept]
    positions = ()
    if "positions" in kinds:
        positions = tuple(draw(st.lists(NAMES | POINTS, max_size=6)))
    objects = tuple(draw(NAMES) for kind in kinds if kind == "object")
    return SkillCall(skill=skill.name, objects=objects, positions=positions, line=1)


def test_skills_are_the_thirteen_of_listing_2():
    assert [skill.name for skill in SKILLS] == [
        "GoToObject", "PickupObject", "PutObject", "SwitchOn", "SwitchOff", "OpenObject",
        "CloseObject", "BreakObject", "SliceObject", "ThrowObject", "Explore", "ToggleOn",
        "ToggleOff",
    ]  # fmt: skip


@given(calls())
def test_parse_of_a_written_call_returns_the_call(call):
    assert parse_program(str(call)) == (call,)


@given(st.lists(calls(), max_size=8))
def test_parse_of_a_program_keeps_order_and_counts_lines(program):
    text = "\n".join(str(call) for call in program)
    assert parse_program(text) == tuple(replace(c, line=n) for n, c in enumerate(program, 1))


@settings(max_examples=300)
@given(st.text() | st.text("GoToObject(robot,'A')\n \t[]{}#`\"\\\0=.:;*@-1e"))
def test_parse_of_any_text_returns_calls_or_raises_program_error(text):
    try:
        assert all(isinstance(call, SkillCall) for call in parse_program(text))
    except ProgramError as error:
        assert error.reason and error.line >= 1


@given(calls(), st.integers(0, 60), st.text("()[]'\",.\\\0\n#x0= ", max_size=3))
def test_parse_of_a_damaged_call_never_raises_anything_else(call, at, junk):
    text = str(call)
    try:
        parse_program(text[:at] + junk + text[at:])
    except ProgramError as error:
        assert str(error).startswith("line ")


def test_parse_accepts_fence_comments_indent_quotes_and_robots():
    text = """```python
    # wash it

    GoToObject(robots, "Apple")  # double quotes
    PutObject(robot,'Sink'); ToggleOn(robot, 'Faucet')
    Explore(robot, 'Mug', [
        'node_3',
        (1, -0.5, 2.25),
    ])
    ```
    """
    assert parse_program(text) == (
        SkillCall(skill="GoToObject", objects=("Apple",), line=4),
        SkillCall(skill="PutObject", objects=("Sink",), line=5),
        SkillCall(skill="ToggleOn", objects=("Faucet",), line=5),
        SkillCall(
            skill="Explore", objects=("Mug",), positions=("node_3", (1.0, -0.5, 2.25)), line=6
        ),
    )


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing to do", "```python\n```", "```\n"])
def test_parse_of_a_text_without_calls_returns_no_calls(text):
    assert parse_program(text) == ()


ATTACKS = [
    "__import__('os').system('true')",
    "import os",
    "from os import system",
    "eval(robot, 'x')",
    "exec('x')",
    "().__class__.__bases__[0].__subclasses__()",
    "GoToObject.__globals__",
    "robot.GoToObject('Apple')",
    "GoToObject(robot, f'{open(1)}')",
    "GoToObject(robot, f'Apple')",
    "GoToObject(robot, b'Apple')",
    "GoToObject(robot, 'App' + 'le')",
    "GoToObject(robot, name)",
    "GoToObject(robot, *names)",
    "GoToObject(robot, **names)",
    "GoToObject(robot, dest_obj='Apple')",
    "GoToObject(robot, GoToObject(robot, 'Apple'))",
    "GoToObject(robot, (lambda: 'Apple')())",
    "GoToObject(robot, ['Apple'])",
    "GoToObject(robot, [x for x in 'ab'])",
    "GoToObject(robot, None)",
    "GoToObject(robot, 3)",
    "GoToObject(robot, '')",
    "GoToObject(robot, 'it\\'s')",
    "GoToObject(robot, 'a\\nb')",
    "GoToObject(robot, 'a\\x00b')",
    "GoToObject(robot, 'Apple', 'Fridge')",
    "GoToObject(robot)",
    "GoToObject()",
    "GoToObject('Apple')",
    "GoToObject(robots[0], 'Apple')",
    "PutObject(robot, 'a', 'b', 'c')",
    "Explore(robot, 'Apple', 'node_1')",
    "Explore(robot, 'Apple', (1, 2, 3))",
    "Explore(robot, 'Apple', [(1, 2)])",
    "Explore(robot, 'Apple', [(True, 2, 3)])",
    "Explore(robot, 'Apple', [(1e999, 2, 3)])",
    "Explore(robot, 'Apple', [(1j, 2, 3)])",
    "Explore(robot, 'Apple', [(--1, 2, 3)])",
    "Explore(robot, 'Apple', [(9**9, 2, 3)])",
    "Explore(robot, 'Apple', [[1, 2, 3]])",
    "Explore(robot, 'Apple', [*range(9)])",
    f"Explore(robot, 'Apple', [{'(1,1,1),' * 101}])",
    f"Explore(robot, 'Apple', [({'9' * 5000}, 2, 3)])",
    "x = GoToObject(robot, 'Apple')",
    "(x := 1)",
    "x: int = 1",
    "x += 1",
    "for _ in 'ab': GoToObject(robot, 'Apple')",
    "while True: GoToObject(robot, 'Apple')",
    "if True: GoToObject(robot, 'Apple')",
    "with open('x') as f: pass",
    "try:\n    GoToObject(robot, 'Apple')\nexcept E: pass",
    "def f():\n    GoToObject(robot, 'Apple')",
    "async def f(): pass",
    "class A: pass",
    "@GoToObject\ndef f(): pass",
    "await GoToObject(robot, 'Apple')",
    "yield GoToObject(robot, 'Apple')",
    "GoToObject(robot, 'Apple') or GoToObject(robot, 'Mug')",
    "GoToObject(robot, 'Apple').x",
    "GoToObject(robot, 'Apple')()",
    "[GoToObject(robot, 'Apple')]",
    "'GoToObject'",
    "del robot",
    "global robot",
    "assert 0",
    "raise SystemExit",
    "match 1:\n    case _: pass",
    "pass",
    "Sure, here is the program:",
    "```python\nGoToObject(robot, 'Apple')\n```\nThat is all.",
    "GoToObject(robot, 'Apple'",
    "GoToObject(robot, 'Apple)",
    "\0",
    "GoToObject(robot, 'Apple')\n\0",
    "\ud800",
    "GoToObject(robot, '\ud800')",
    "(" * 5000 + ")" * 5000,
    "[" * 150 + "]" * 150,
    "-" * 19_000 + "1",
    "not " * 4_900 + "1",
    "~" * 5_900 + "1",
    "a" + ".a" * 9_900,
    "a" + "()" * 9_900,
    "a" + "[0]" * 6_000,
    "1" + "+1" * 9_900,
    "lambda:" * 2_800 + "1",
    "x" * 30_000,
    "x" * 19_000 + "(robot, 'Apple')",
    f"GoToObject(robot, '{'x' * (MAX_NAME + 1)}')",
    "\n".join(" " * n + "if 1:" for n in range(150)),
    "GoToObject(robot, 'Apple')\n" * (MAX_LINES + 1),
]


@pytest.mark.parametrize("text", ATTACKS, ids=range(len(ATTACKS)))
def test_parse_of_an_attack_raises_program_error(text):
    with pytest.raises(ProgramError):
        parse_program(text)


def test_refusal_names_line_code_and_nearest_skill():
    with pytest.raises(ProgramError) as caught:
        parse_program("GoToObject(robot, 'Mug')\n\nGotoobjects(robot, 'Apple')")
    assert caught.value.line == 3
    assert caught.value.code == "Gotoobjects(robot, 'Apple')"
    assert caught.value.reason.endswith("Did you mean GoToObject?")


# ----------------------------------------------------------------- refusals


def test_refusal_beside_calls_is_no_program():
    with pytest.raises(ProgramError, match="refuse stands alone, with one of deed, thing"):
        parse_program("GoToObject(robot, 'Mug')\nrefuse('deed')")
