"""The stored form of each event: a line of a step log, and a part of an episode's record."""

from collections.abc import Sequence
from typing import Any, Self

import msgspec

from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import MemoryUnit
from karma.types.planning import RefusedRequest


class Answer(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="plan"):
    """One planner call: what was asked and recalled, the program as written, and its cost."""

    program: str
    prompt: str = ""  # its changing part; the stable part is in the step log
    recalled: tuple[str, ...] = ()  # ids of the units in the prompt
    examples: tuple[str, ...] = ()  # instructions of the worked examples that were retrieved
    error: str = ""  # why the answer was refused
    dropped: tuple[str, ...] = ()  # lines that were no part of the program, where no grammar held
    refused: RefusedRequest | None = None  # the request, in place of a program
    finish: str = "stop"
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    cost: float | None = None  # of a hosted model, in the currency of the price table
    constrained: bool | None = None  # a grammar held; None where it is not known
    reasoning: str = ""  # of a thinking model, before the program

    @classmethod
    def of(cls, plan: Plan) -> Self:
        """Return the stored form of a plan; its times are in the episode's timing."""
        completion = plan.completion
        return cls(
            program=completion.text,
            prompt=plan.prompt.changing,
            recalled=tuple(unit.object_id for unit in plan.units),
            examples=plan.examples,
            error=plan.error,
            dropped=plan.dropped,
            refused=plan.refused,
            finish=completion.finish,
            prompt_tokens=completion.prompt_tokens,
            completion_tokens=completion.completion_tokens,
            cost=completion.cost,
            constrained=completion.constrained,
            reasoning=completion.reasoning,
        )


class Call(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="skill"):
    """One skill call and how it went; in a step log its actions stand before it."""

    text: str
    ok: bool
    reason: str = ""
    actions: int = 0
    explorations: int = 0
    object_ids: tuple[str, ...] = ()

    @classmethod
    def of(cls, result: SkillResult) -> Self:
        """Return the stored form of a result."""
        return cls(
            text=str(result.call),
            ok=result.ok,
            reason=result.reason,
            actions=result.actions,
            explorations=result.explorations,
            object_ids=result.object_ids,
        )


class Ended(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="outcome"):
    """The instruction has ended."""

    finished: bool
    resident: tuple[MemoryUnit, ...]  # short-term memory before it
    kept: tuple[MemoryUnit, ...]  # and after it
    unmet: tuple[str, ...]  # goals that do not hold

    @classmethod
    def of(cls, outcome: Outcome, unmet: Sequence[str]) -> Self:
        """Return the stored form of an outcome, with what the goals say of it."""
        return cls(
            finished=outcome.finished,
            resident=outcome.resident,
            kept=outcome.kept,
            unmet=tuple(unmet),
        )


# ----------------------------------------------------------------- in step logs only


class Enter(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="enter"):
    """The agent is in a room; the actions after it are there.

    What the hand held was put down in the room that it left: see `karma.world.home`.
    """

    scene: str  # a scene of ours, or the name of a file in the run folder's `scenes`


class Instruction(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="subtask"):
    """An instruction is given."""

    number: int  # from 0
    instruction: str


class Map(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="map"):
    """The stable part of the prompt; only where it has changed."""

    text: str


class Action(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="action"):
    """The world did one action, or refused it."""

    action: str
    arguments: dict[str, Any]
    ok: bool
    error: str


Entry = Enter | Instruction | Map | Answer | Action | Call | Ended
