"""Write what LoTa-Bench's planners are told: a lead, examples, the instruction, the steps so far.

The parts and their order are the source's; the words are ours (`prompt.toml`, `examples.toml`).
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import msgspec

from karma.contracts import Prompt
from karma.files import read_toml
from karma.world.eb_alfred.environment import Step
from karma.world.eb_alfred.skills import DONE

_HERE = Path(__file__).parent
FILES = (_HERE / "prompt.toml", _HERE / "examples.toml")


class _ListParts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What stands around the parts where a whole list is asked for."""

    examples: str
    skills: str
    answer: str
    asked: str


class _PromptParts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    lead: tuple[str, ...]
    again: str
    role: str
    whole: _ListParts


class StepExample(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An instruction and the steps that carry it out, in a trial that no task is of."""

    trial: str
    instruction: str
    steps: tuple[str, ...]
    failures: dict[str, str] = {}  # place of a step that fails, from 1 -> what is told of it


class _StepExamples(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    example: tuple[StepExample, ...]


class LotaPromptOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a planner is asked."""

    examples: int = 6  # at most, one of each type of task
    failures: bool = False  # whether steps that failed are told: `use_predefined_prompt`
    max_tokens: int = 500  # of a whole list
    temperature: float = 0.0  # likewise


@cache
def _texts() -> _PromptParts:
    return read_toml(FILES[0], _PromptParts)


@cache
def examples() -> tuple[StepExample, ...]:
    """Return the worked examples, those with failures last."""
    return read_toml(FILES[1], _StepExamples).example


def score_prompt(
    instruction: str, steps: Sequence[Step], options: LotaPromptOptions
) -> tuple[str, ...]:
    """Return the prompt that a skill follows, in segments: a step each that was taken."""
    asked = f"Human: {instruction.strip()}\nRobot: 1."
    taken = [
        f" {step.name}{_told(step.feedback) if options.failures and not step.ok else ''}, {place}."
        for place, step in enumerate(steps, 2)
    ]
    return (_shown("\n".join(_texts().lead) + "\n", options), asked, *taken)


def list_prompt(instruction: str, skills: Sequence[str], options: LotaPromptOptions) -> Prompt:
    """Return the prompt for a whole list."""
    texts = _texts()
    parts = [
        texts.role,
        f"{texts.whole.examples}\n{_shown('', options)}".rstrip(),
        texts.whole.skills % ", ".join(skills),
        texts.whole.answer,
    ]
    asked = texts.whole.asked % instruction.strip()
    return Prompt(stable="\n\n".join(parts) + "\n\n", changing=f"{asked}\n")


def _shown(lead: str, options: LotaPromptOptions) -> str:
    """Return the lead and the examples that are wanted."""
    plain = [one for one in examples() if not one.failures][: options.examples]
    failing = [one for one in examples() if one.failures] if options.failures else []
    lines = [*map(_example, plain), *([_texts().again] if failing else [])]
    return lead + "".join(f"{line}\n" for line in [*lines, *map(_example, failing)])


def _example(one: StepExample) -> str:
    said = [
        f"{place}. {step}{_told(one.failures.get(str(place), ''))}"
        for place, step in enumerate(one.steps, 1)
    ]
    taken = ", ".join([*said, f"{len(said) + 1}. {DONE}."])
    return f"Human: {one.instruction}\nRobot: {taken}"


def _told(failure: str) -> str:
    """Return how a failure is told behind its step."""
    reason = failure.removeprefix("Invalid: ").rstrip(".").lower()
    return f" (this action failed: {reason})" if reason else ""
