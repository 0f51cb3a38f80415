"""The step log of an episode: everything that happened, one JSON line each, in its order.

The actions stand there with their exact arguments, from the last reset before the first
instruction on: reset the embedded world to the scene, do them, and it goes through the episode
again. A log is the same in every run of the same experiment, so what a method did to get to know
the room is not in it: after that it resets the world.
"""

import gzip
import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from hashlib import blake2b
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Self

import msgspec

from karma.agent.planning.refused import sentence
from karma.agent.seeing.perceive import refusal
from karma.errors import FileError
from karma.files import read_bytes, to_json, unpack
from karma.journal.owned_folder import STEPS
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import MemoryUnit
from karma.types.roles import Event
from karma.types.tasks import SubTask

_LONGEST_SLUG = 80  # characters


class Start(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="start"):
    """The world has been reset; actions before the first instruction set the episode up."""

    scene: str  # one of ours, or the name of a file in the run folder's `scenes`
    seed: int


class Enter(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="enter"):
    """The agent has gone into another room of the home; the actions after it are there.

    What the hand held was put down in the room that it left: see `karma.world.home`.
    """

    scene: str  # as in `Start`


class Instruction(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="subtask"):
    """An instruction is given."""

    number: int  # from 0
    instruction: str
    memory: tuple[MemoryUnit, ...]  # short-term memory before it


class Map(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="map"):
    """The stable part of the prompt; only where it is not the last one again."""

    text: str


class Planned(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="plan"):
    """The planner was asked and has answered."""

    recalled: tuple[str, ...]  # ids of the units in the prompt
    prompt: str  # its changing part
    program: str
    error: str  # why the answer was refused
    examples: tuple[str, ...] = ()  # instructions of the worked examples that were retrieved
    refused: str = ""  # what people are told where the request is not carried out

    @classmethod
    def of(cls, plan: Plan) -> Self:
        """Return what the log keeps of a plan."""
        return cls(
            recalled=tuple(unit.object_id for unit in plan.units),
            prompt=plan.prompt.changing,
            program=plan.completion.text,
            error=plan.error,
            refused=sentence(plan.refused) if plan.refused else "",
            examples=plan.examples,
        )


class Action(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="action"):
    """The world did one action, or refused it."""

    action: str
    arguments: dict[str, Any]
    ok: bool
    error: str


class SkillStep(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="skill"):
    """A skill has ended; its actions stand before it."""

    call: str
    ok: bool
    reason: str
    object_ids: tuple[str, ...]


class Ended(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="outcome"):
    """The instruction has ended."""

    finished: bool
    memory: tuple[MemoryUnit, ...]  # short-term memory after it
    unmet: tuple[str, ...]  # goals that do not hold


Step = Start | Enter | Instruction | Map | Planned | Action | SkillStep | Ended


_ASK_ONLY = frozenset(("GetReachablePositions", "GetInteractablePoses", "GetShortestPath"))


class StepLog:
    """Collects one episode's steps; `data` are the lines."""

    def __init__(self) -> None:
        self._written = bytearray()  # lines of what is over
        self._steps: list[Step] = []  # since the last instruction came to its end
        self._open = False
        self._given = 0  # where the last instruction stands among them
        self.actions: list[Action] = []  # since it was given, but for what only asks
        self._map: str | None = None
        self._memory: tuple[MemoryUnit, ...] = ()

    def reset(self) -> None:
        """The world is reset; what was done to it before `start` no longer counts."""
        if not self._open:
            self._steps.clear()

    def start(self, scene: str, seed: int) -> None:
        """The method is ready."""
        self._steps.insert(0, Start(scene=scene, seed=seed))
        self._open = True

    def add(self, step: Step) -> None:
        """Write one step."""
        asks = isinstance(step, Action) and step.action in _ASK_ONLY
        if isinstance(step, Action) and not asks:
            self.actions.append(step)
        if self._open or not asks:  # what is asked of a room depends on whether it is known
            self._steps.append(step)

    def watch(self, action: str, arguments: Mapping[str, Any], event: Event) -> None:
        """Write one action down."""
        why, plain = refusal(event), _as_json(arguments)
        error = why.words if why is not None else ""
        self.add(Action(action=action, arguments=plain, ok=why is None, error=error))

    def instruction(self, number: int, subtask: SubTask) -> None:
        """An instruction is given; memory before it is what it was, until the outcome tells."""
        self._given = len(self._steps)
        self.actions = []
        text = subtask.instruction
        self.add(Instruction(number=number, instruction=text, memory=self._memory))

    def event(self, event: Plan | SkillResult) -> None:
        """Write an answer or a call's result."""
        if isinstance(event, Plan):
            if event.prompt.stable != self._map:
                self._map = event.prompt.stable
                self.add(Map(text=self._map))
            self.add(Planned.of(event))
        else:
            ids, ok, call = event.object_ids, event.ok, str(event.call)
            self.add(SkillStep(call=call, ok=ok, reason=event.reason, object_ids=ids))

    def outcome(self, outcome: Outcome, unmet: Sequence[str]) -> None:
        """Write how the instruction ended, and what memory held when it was given."""
        given = self._steps[self._given]
        if isinstance(given, Instruction):
            self._steps[self._given] = msgspec.structs.replace(given, memory=outcome.resident)
        self._memory = outcome.kept
        self.add(Ended(finished=outcome.finished, memory=self._memory, unmet=tuple(unmet)))
        self._written += self._lines()
        self._steps.clear()

    def go_back(self, before: "StepLog") -> None:
        """Hold what a copy of this log holds: what came after it never happened."""
        vars(self).update(deepcopy(vars(before)))

    def data(self) -> bytes:
        """Return the lines so far."""
        return bytes(self._written) + self._lines()

    def _lines(self) -> bytes:
        return b"".join(to_json(step) for step in self._steps if self._open)


def _as_json(value: Any) -> Any:
    """Return an argument as JSON has it; numpy's numbers are numbers."""
    match value:
        case str() | bool() | None:
            return value
        case Mapping():
            return {str(name): _as_json(one) for name, one in value.items()}
        case Integral():
            return int(value)
        case Real():
            return float(value)
        case Sequence():
            return [_as_json(one) for one in value]
        case _:
            return value.tolist() if hasattr(value, "tolist") else str(value)


# ----------------------------------------------------------------- files


def steps_path(folder: Path, row: str, task: str, seed: int) -> Path:
    """Return where an episode's log lies in a run folder."""
    return folder / STEPS / slug(row) / f"{slug(task)}-{seed}.jsonl.gz"


def slug(text: str) -> str:
    """Return a name for a file; texts that differ get names that differ.

    >>> slug("simple-04")
    'simple-04'
    >>> slug("KARMA (w/o short term memory)")
    'karma-w-o-short-term-memory-93c17b'
    """
    plain = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:_LONGEST_SLUG]
    if plain == text:
        return plain
    data = text.encode(errors="backslashreplace")
    return f"{plain}-{blake2b(data, digest_size=3).hexdigest()}".lstrip("-")


def packed(data: bytes) -> bytes:
    """Return a log's lines as they lie on the disk; equal lines give equal bytes."""
    return gzip.compress(data, compresslevel=6, mtime=0)


def read_steps(path: Path) -> list[Step]:
    """Read one episode's log; FileError where it is missing, or names the damaged line."""
    fix = "run it again: karma eval"
    lines = unpack(read_bytes(path, fix=fix), path=path, fix=fix).splitlines()
    decoder: msgspec.json.Decoder[Step] = msgspec.json.Decoder(Step)
    found = []
    for number, line in enumerate(lines, start=1):
        try:
            found.append(decoder.decode(line))
        except (msgspec.DecodeError, RecursionError) as error:
            raise FileError(path, f"line {number}: {error}") from error
    return found
