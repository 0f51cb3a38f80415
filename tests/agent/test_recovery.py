"""Programs found in talk, and what is never taken for one."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.agent.planning.recovery import program_of
from karma.errors import ProgramError
from karma.types.completion import Completion
from karma.types.planning import RefusedRequest

PROGRAM = "GoToObject(robot, 'Mug')\nPutObject(robot, 'Mug', 'Sink')\n"
CALLS = ["GoToObject(robot, 'Mug')", "PutObject(robot, 'Mug', 'Sink')"]


def said(text, **more):
    fields = {
        "finish": "stop", "prompt_tokens": 1, "reused_tokens": None, "completion_tokens": 1,
        "first_token_s": None, "total_s": 0.1,
    }  # fmt: skip
    return Completion(text=text, **fields, **more)


TALK = {
    "talk before": f"Sure! Here is the program:\n\n{PROGRAM}",
    "talk after": f"{PROGRAM}\nThis puts the mug into the sink. Let me know!",
    "fence in the middle": f"Here you go:\n```python\n{PROGRAM}```\nDone (I hope).",
    "numbers": "1. GoToObject(robot, 'Mug')\n2) PutObject(robot, 'Mug', 'Sink')",
    "steps": "Step 1: GoToObject(robot, 'Mug')\nStep 2: PutObject(robot, 'Mug', 'Sink')",
    "bullets": "- GoToObject(robot, 'Mug')\n* PutObject(robot, 'Mug', 'Sink')",
    "ticks": "- `GoToObject(robot, 'Mug')`\n- `PutObject(robot, 'Mug', 'Sink')`",
    "bold": "1. **GoToObject(robot, 'Mug')**\n2. **PutObject(robot, 'Mug', 'Sink')**",
    "reasons": "1. GoToObject(robot, 'Mug') - find it\n2. PutObject(robot, 'Mug', 'Sink') # wash",
    "semicolons": "GoToObject(robot, 'Mug');\nPutObject(robot, 'Mug', 'Sink');\nThat's it",
    "Windows": "OK:\r\nGoToObject(robot, 'Mug')\r\nPutObject(robot, 'Mug', 'Sink')\r\n",
}


@pytest.mark.parametrize("text", TALK.values(), ids=TALK)
def test_program_is_found_among_talk_and_marks(text):
    found = program_of(said(text, constrained=False))
    assert [str(call) for call in found.calls] == CALLS
    lines = text.replace("\r\n", "\n").split("\n")
    assert [call.skill in lines[call.line - 1] for call in found.calls] == [True, True]
    kept = {line.strip() for line in lines if "robot" in line}
    assert not kept & set(found.dropped)


def test_answer_that_a_grammar_held_is_read_strictly():
    with pytest.raises(ProgramError, match="line 1: not a program"):
        program_of(said(f"Sure! Here:\n{PROGRAM}", constrained=True))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("for i in range(3):\n    GoToObject(robot, 'Mug')", "a loop"),
        ("Sure!\nfor i in range(3):\n    GoToObject(robot, 'Mug')", "not a program"),
        ("Sure!\nif hungry:\n  GoToObject(robot, 'Mug')\nBye", "not a program"),
        ("x = 1\nGoToObject(robot, 'Mug')", "an assignment"),
        ("I would call GoToObject(robot, 'Mug') first.", "not a program"),
        ("I cannot help with that.", "not a program"),
        ("Sure!\nFlyTo(robot, 'Mug')", "there is no skill FlyTo"),
        ("Sure!\n1. GoToObject(robot, Mug)", "an object is a quoted name"),
        ("Here:\nGoToObject(robot, __import__('os').system('x'))", "a quoted name"),
        ("robot.GoToObject('Mug')", "only skill calls"),
    ],
)
def test_what_is_no_program_is_refused_by_what_is_wrong_with_it(text, named):
    with pytest.raises(ProgramError, match=named):
        program_of(said(text))


@pytest.mark.parametrize("text", [
    "refuse('thing')", "refuse('thing')\n", "I am sorry.\n`refuse('thing')`",
    "- no\nrefuse('thing').",
    "```python\nrefuse('thing')\n```",
])  # fmt: skip
def test_refusal_is_found_in_an_answer_of_one_who_may_refuse(text):
    found = program_of(said(text), refusing=True)
    assert (found.refused, found.calls) == (RefusedRequest(kind="thing"), ())
    assert all(line in text and "refuse" not in line for line in found.dropped)
    with pytest.raises(ProgramError):
        program_of(said(text))


@pytest.mark.parametrize(
    "text", ["refuse('thing')\n" + PROGRAM, "refuse('thing')\nrefuse('deed')", "refuse('mood')"]
)
def test_refusal_beside_calls_or_of_no_kind_is_refused_itself(text):
    with pytest.raises(ProgramError):
        program_of(said(text), refusing=True)


# ----------------------------------------------------------------- whole, or a fault

SIGNS = ("<|im_end|>", "</s>", "<|eot_id|>", "<end_of_turn>", "<|end|>", "<|endoftext|>", "[/INST]",
         "<｜end▁of▁sentence｜>", "<|END_OF_TURN_TOKEN|>", "<|return|>", "<eos>")  # fmt: skip


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("after", ["", "\n", "\n<|im_start|>user\nGoToObject(robot, 'Pan')"])
def test_sign_that_ends_a_turn_is_no_part_of_the_answer(sign, after):
    found = program_of(said(f"<|im_start|>assistant\n{PROGRAM.strip()}{sign}{after}"))
    assert [str(call) for call in found.calls] == CALLS


@pytest.mark.parametrize(
    "line",
    ["PutObject(robot, 'Mug', 'Sink') to wash it", "then PutObject(robot, 'Mug', 'Sink')",
     "PutObject(robot, 'Mug' 'Sink'", "PutObject (robot, 'Mug', Sink)", "robot.put('Mug', 'Sink')",
     "// PutObject(robot, 'Mug', 'Sink')", "So I call PutObject(robot, 'Mug', 'Sink') now.",
     "PutObject(robots, 'Mug", "PutObj", "PutObject(", "PutObject", "2. Put", "2.", "- P"],
)  # fmt: skip
def test_line_with_a_call_that_cannot_be_read_makes_the_answer_no_program(line):
    with pytest.raises(ProgramError, match=r"line 3: (a call on this line|only skill calls)"):
        program_of(said(f"Sure!\nGoToObject(robot, 'Mug')\n{line}"))


@pytest.mark.parametrize(
    ("text", "calls"),
    [
        (f"Draft:\nGoToObject(robot, 'Pan')\nThat is wrong. Corrected:\n{PROGRAM}", CALLS),
        (f"```\n{PROGRAM}```\nWait, it must be opened.\n```\n{PROGRAM}```", CALLS),
        ("```\nGoToObject(robot, 'Mug')\n```\nand then\n```\nPutObject(robot, 'Mug', 'Sink')\n```",
         CALLS),
        ("Wash it:\nGoToObject(robot, 'Mug')\nTake it there:\nGoToObject(robot, 'Mug')\n"
         "PickupObject(robot, 'Mug')", ["GoToObject(robot, 'Mug')"] * 2
         + ["PickupObject(robot, 'Mug')"]),
    ],
)  # fmt: skip
def test_program_that_begins_anew_replaces_the_draft_and_one_that_goes_on_does_not(text, calls):
    assert [str(call) for call in program_of(said(text)).calls] == calls


@pytest.mark.parametrize(
    "text",
    ["GoToObject（robot， 'Mug'）\nPutObject（robot，'Mug'，'Sink'）",
     "GoToObject(robot, ‘Mug’)\nPutObject(robot, “Mug”, ‘Sink’)",
     "GoToObject(robot,\u00a0'Mug')\nPutObject(robot,\u3000'Mug',\u202f'Sink')；",
     "1．GoToObject(robot, ’Mug’)\n2．PutObject(robot, 'Mug', “Sink„)"],
)  # fmt: skip
def test_signs_that_look_like_ascii_s_mean_the_same(text):
    assert [str(call) for call in program_of(said(text)).calls] == CALLS


LINES = st.sampled_from([
    "GoToObject(robot, 'Mug')", "PickupObject(robot, 'Apple_2')",
    "Explore(robot, 'Egg', ['node_1'])",
    "PutObject(robot, 'Mug', 'Sink')", "ToggleOn(robot, 'Faucet')", "OpenObject(robot, 'Fridge')",
])  # fmt: skip
DRESS = st.sampled_from(
    ["{}", "Sure!\n{}", "```python\n{}\n```", "1. {}", "- `{}`", "{}<|im_end|>"]
)


@given(lines=st.lists(LINES, min_size=1, max_size=5, unique=True), dress=DRESS, data=st.data())
def test_no_cut_of_a_program_within_a_line_is_carried_out(lines, dress, data):
    whole = dress.format("\n".join(lines))
    cut = data.draw(st.integers(0, len(whole)))
    text = whole[:cut]
    for fault in ("", "the answer was cut off"):
        try:
            calls = [str(call) for call in program_of(said(text, fault=fault)).calls]
        except ProgramError:
            continue
        assert not fault
        assert calls == lines[: len(calls)]
        rest = text.rpartition(calls[-1])[2] if calls else text
        assert not any(char.isalnum() for char in rest.replace("python", "").replace("im_end", ""))
