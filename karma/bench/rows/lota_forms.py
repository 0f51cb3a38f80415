"""Prompts of the LoTa rows, two forms for each row, and the closed lists of steps.

`words` is LoTa-Bench's own form, a dialogue of numbered steps, for any language model. `compact` is
for planners that were trained on the compact profile: lines of programs. `code` is the whole plan
in one answer, with SMART-LLM's skills. Object types are the fixed list of `karma.household.types`:
nothing of a scene.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from karma.agent.planning.inspector import objection
from karma.agent.planning.program import SKILLS
from karma.agent.planning.prompt import compact, template
from karma.bench.rows.baseline import request_for
from karma.contracts import END, Prompt, SeenObject, Skill, SkillCall
from karma.household.types import in_words, object_types
from karma.household.uses import has_a_switch

Form = Literal["words", "compact"]

DONE = " done."  # in words
_PROMPTS = Path(__file__).parent
_NOT_SMART_LLM = ("Explore", "ToggleOn", "ToggleOff")
_VERBS = (
    ("pick up the", "PickupObject"), ("put down the", "PutObject"), ("open the", "OpenObject"),
    ("close the", "CloseObject"), ("slice the", "SliceObject"), ("turn on the", "ToggleOn"),
    ("turn off the", "ToggleOff"), ("break the", "BreakObject"), ("throw away the", "ThrowObject"),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """An instruction of the sequence and the steps that were taken for it."""

    instruction: str
    steps: tuple[str, ...]


# ----------------------------------------------------------------- the closed lists


@cache
def named_types() -> tuple[str, ...]:
    """Return the object types that a step may name; a piece is called as the whole is."""
    return tuple(name for name, kind in object_types().items() if not kind.made_by_slicing)


@cache
def steps_in_words() -> Mapping[str, SkillCall | None]:
    """Return LoTa-Bench's list of steps with the call of each; None ends the instruction.

    Each step ends with the comma that would follow it, so that none begins another. `put down`
    names what is in the hand; its place is what was found last.
    """
    found: dict[str, SkillCall | None] = {DONE: None}
    for name in named_types():
        article = "an" if name[0] in "AEIOU" else "a"
        found[f" find {article} {in_words(name)},"] = SkillCall.of("Explore", name)
    for words, skill in _VERBS:
        for name in named_types():
            probe = "PickupObject" if skill in ("PutObject", "ThrowObject") else skill
            if _possible(SkillCall.of(probe, name)):
                found[f" {words} {in_words(name)},"] = SkillCall.of(skill, name)
    return MappingProxyType(found)


@cache
def steps_in_lines() -> Mapping[str, SkillCall | None]:
    """Return the same list as lines of programs, in which `PutObject` names the place too."""
    calls = [SkillCall.of("GoToObject", name) for name in named_types()]
    carried = [name for name in named_types() if _possible(SkillCall.of("PickupObject", name))]
    for skill in ("PickupObject", "OpenObject", "CloseObject", "SliceObject", "BreakObject",
                  "ToggleOn", "ToggleOff", "SwitchOn", "SwitchOff"):  # fmt: skip
        calls += [c for name in named_types() if _possible(c := SkillCall.of(skill, name))]
    calls += [SkillCall.of("ThrowObject", name) for name in carried]
    calls += [
        put
        for name in carried
        for place in named_types()
        if not objection([put := SkillCall.of("PutObject", name, place)], held=name)
    ]
    return MappingProxyType({END: None, **{f"{call}\n": call for call in calls}})


def _possible(call: SkillCall) -> bool:
    name = call.objects[0]
    if call.skill in ("SwitchOn", "SwitchOff", "ToggleOn", "ToggleOff"):
        return has_a_switch(name)
    return not objection([call], held=None)


# ----------------------------------------------------------------- prompts in segments


def words_prompt(
    history: Sequence[Past], instruction: str, steps: Sequence[str]
) -> tuple[str, ...]:
    """Return the dialogue so far: examples, earlier instructions, this one and its steps."""
    segments = [_text("lota_score.txt")]
    for past in history:
        segments += [_asked(past.instruction), *_numbered(past.steps), "\n"]
    return (*segments, _asked(instruction), *_numbered(steps))


def _asked(instruction: str) -> str:
    return f"Human: {_sentence(instruction)}\nRobot: 1."


def _numbered(steps: Sequence[str]) -> list[str]:
    return [
        step if step == DONE else f"{step} {number}." for number, step in enumerate(steps, start=2)
    ]


def lines_prompt(
    instruction: str, held: SeenObject | None, steps: Sequence[str]
) -> tuple[str, ...]:
    """Return the compact prompt without memory, followed by the program so far.

    Earlier instructions are left out: planners of this profile were never shown any.
    """
    prompt = compact(request_for(instruction, held)).prompt
    return (prompt.stable, prompt.changing, *steps)


def smart_skills() -> tuple[Skill, ...]:
    """Return those of our skills that SMART-LLM has too."""
    return tuple(skill for skill in SKILLS if skill.name not in _NOT_SMART_LLM)


def code_prompt(history: Sequence[Past], instruction: str) -> Prompt:
    """Return the prompt for a whole plan: skills, object types, examples, earlier plans."""
    stable = template(_PROMPTS / "lota_generate.txt").render(
        skills=smart_skills(), objects=named_types()
    )
    past = [
        f"# Task Description: {_sentence(one.instruction)}\n{''.join(one.steps)}\n"
        for one in history
    ]
    asked = f"# Task Description: {_sentence(instruction)}\n"
    return Prompt(stable=stable, changing="".join(past) + asked)


def _sentence(text: str) -> str:
    """Return an instruction with a capital and a full stop."""
    text = " ".join(text.split()).rstrip(".!? ")
    return f"{text[:1].upper()}{text[1:]}."


@cache
def _text(name: str) -> str:
    return (_PROMPTS / name).read_text(encoding="utf-8")
