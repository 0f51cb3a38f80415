"""Replay step logs in the embedded world, with pictures, and count the actions that differ.

A log is read as instructions, attempts (each with a program) and skill calls.
"""

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from karma.bench.report.html import data_uri
from karma.errors import KarmaError
from karma.journal.entries import (
    Action,
    Answer,
    Call,
    Ended,
    Enter,
    Entry,
    Instruction,
    Map,
)
from karma.journal.records import EpisodeRecord
from karma.journal.run_folder import RunData
from karma.journal.steps import read_steps, steps_path
from karma.types.memory import MemoryUnit
from karma.types.roles import Event
from karma.types.space import Frame
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

MAX_PICTURED_CALLS = 1000  # of a page; beyond it only the ends of instructions have a picture
SIZE_PX = 300
WEBP_QUALITY = 72  # about 3 kB for a drawn room


def episode_key(record: EpisodeRecord) -> str:
    """Return the name of an episode in the page and on the command line."""
    return f"{record.row}/{record.task}/{record.seed}"


def choose(records: Sequence[EpisodeRecord], wanted: str) -> list[EpisodeRecord]:
    """Return the episodes to replay, in the run's order.

    `wanted` is "all"; a number of episodes: failures first, taken from the methods in turn; the id
    of a task; or the key of an episode, "ROW/TASK/SEED".

    Raises:
        KarmaError: it is none of these.
    """
    if wanted == "all":
        return list(records)
    named = [record for record in records if wanted in (record.task, episode_key(record))]
    if named:
        return named
    if not wanted.isdecimal():
        tasks = list(dict.fromkeys(record.task for record in records))
        raise KarmaError(
            f"--episodes {wanted!r}: neither a number nor a task nor an episode of the run\n"
            f"  To fix: all, a number, ROW/TASK/SEED, or one of {', '.join(tasks[:6])}"
            + (f" and {len(tasks) - 6} more" if len(tasks) > 6 else "")
        )
    failed = _in_turn([record for record in records if not record.success])
    solved = _in_turn([record for record in records if record.success])
    kept = {id(record) for record in [*failed, *solved][: int(wanted)]}
    return [record for record in records if id(record) in kept]


def _in_turn(records: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """Return the first episode of each method, then the second of each, and so on."""
    place: dict[str, int] = {}
    ranked = []
    for record in records:
        place[record.row] = place.get(record.row, 0) + 1
        ranked.append((place[record.row], record))
    return [record for _, record in sorted(ranked, key=lambda pair: pair[0])]


# ----------------------------------------------------------------- what a replay holds


@dataclass(slots=True, kw_only=True)
class ReplayedCall:
    """A skill call with its picture."""

    text: str
    ok: bool
    reason: str
    picture: str = ""  # after it; "" if the view did not change


@dataclass(slots=True, kw_only=True)
class Attempt:
    """A program and its skill calls; `plan` is None before the planner answered."""

    plan: Answer | None = None
    calls: list[ReplayedCall] = field(default_factory=list)


@dataclass(slots=True, kw_only=True)
class ReplayedInstruction:
    """An instruction with memory before and after it, and its attempts."""

    instruction: str
    scene: str
    before: tuple[MemoryUnit, ...] = ()
    after: tuple[MemoryUnit, ...] | None = None  # None: the episode broke off
    unmet: tuple[str, ...] = ()
    finished: bool = False
    map_text: str = ""  # long-term memory as in the prompt
    picture: str = ""  # at its start
    attempts: list[Attempt] = field(default_factory=lambda: [Attempt()])

    @property
    def failed(self) -> bool:
        """Whether goals are unmet or the episode broke off in it."""
        return self.after is None or bool(self.unmet)


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeReplay:
    """A replayed episode."""

    record: EpisodeRecord
    instructions: tuple[ReplayedInstruction, ...]
    actions: int
    differing: tuple[int, ...]  # numbers of the actions that did not go as logged, from 0

    @property
    def first_failed(self) -> int | None:
        """The number of the first instruction that failed, from 0."""
        failed = (n for n, part in enumerate(self.instructions) if part.failed)
        return None if self.record.success else next(failed, None)


# ----------------------------------------------------------------- from a log to a replay


def replays(run: RunData, records: Sequence[EpisodeRecord]) -> Iterator[EpisodeReplay]:
    """Yield the replay of each episode that has a step log with a beginning.

    Raises:
        FileError: a log or a scene is damaged.
    """
    logged = [record for record in records if steps_path(run.folder, *record.key).exists()]
    calls = sum(len(sub.calls) for record in logged for sub in record.subtasks)
    for record in logged:
        lines = read_steps(steps_path(run.folder, *record.key))
        if lines:
            yield replay(lines, record, run.folder, each_call=calls <= MAX_PICTURED_CALLS)


def replay(
    lines: Sequence[Entry], record: EpisodeRecord, folder: Path, *, each_call: bool = True
) -> EpisodeReplay:
    """Replay a log up to its end, or to where the episode broke off.

    `each_call`: take a picture after each skill call; False: at the ends of instructions only.
    """
    replayer = _Replayer(folder, each_call)
    for line in lines:
        replayer.take(line)
    return EpisodeReplay(
        record=record,
        instructions=tuple(replayer.instructions),
        actions=replayer.actions,
        differing=tuple(replayer.differing),
    )


class _Replayer:
    """Builds the replay of a log, line by line."""

    def __init__(self, folder: Path, each_call: bool) -> None:
        self._folder, self._each_call = folder, each_call
        self._rooms = Home(lambda: EmbeddedWorld(width=SIZE_PX, height=SIZE_PX))
        self._scene = self._map = self._shown = ""
        self._memory: tuple[MemoryUnit, ...] = ()  # after the last instruction that ended
        self.instructions: list[ReplayedInstruction] = []
        self.actions = 0
        self.differing: list[int] = []

    def take(self, line: Entry) -> None:
        """Process a line of the log."""
        match line:
            case Enter():
                self._scene = line.scene
                self._rooms.enter(self._place(line.scene))
            case Instruction():
                self._begin(line.instruction)
            case Map():
                self._map = line.text
                if self.instructions:
                    self.instructions[-1].map_text = line.text
            case Answer():
                self._plan(line)
            case Action():
                self._act(line)
            case Call():
                self._end_call(line)
            case Ended():
                self._end(line)

    def _begin(self, instruction: str) -> None:
        self.instructions.append(
            ReplayedInstruction(
                instruction=instruction, scene=self._scene, before=self._memory, map_text=self._map,
                picture=self._picture() if self._each_call else "",
            )
        )  # fmt: skip

    def _plan(self, line: Answer) -> None:
        attempts = self._attempts()
        if attempts[-1].plan is None and not attempts[-1].calls:
            attempts[-1].plan = line
        else:
            attempts.append(Attempt(plan=line))

    def _act(self, line: Action) -> None:
        try:
            event: Event | bool = self._rooms.step(line.action, **line.arguments)
        except ValueError:  # misuse, which the log records as a refused action
            event = False
        if bool(event) != line.ok:
            self.differing.append(self.actions)
        self.actions += 1

    def _end_call(self, line: Call) -> None:
        picture = self._picture() if self._each_call else ""
        call = ReplayedCall(text=line.text, ok=line.ok, reason=line.reason, picture=picture)
        self._attempts()[-1].calls.append(call)

    def _end(self, line: Ended) -> None:
        calls = self._attempts()[-1].calls
        part = self.instructions[-1]
        part.before, part.after = line.resident, line.kept
        part.unmet, part.finished = line.unmet, line.finished
        self._memory = line.kept
        if not self._each_call and calls:
            calls[-1].picture = self._picture()

    def _attempts(self) -> list[Attempt]:
        if not self.instructions:
            self._begin("")
        return self.instructions[-1].attempts

    def _place(self, name: str) -> str:
        """Return the scene's file in the run folder, or its name for a shipped scene."""
        imported = self._folder / "scenes" / f"{name}.json"
        return str(imported) if imported.exists() else name

    def _picture(self) -> str:
        """Return the present view as an address; "" if it is the view shown last."""
        frame = self._rooms.last_event.frame
        if frame is None:
            return ""
        key = hashlib.blake2b(frame.tobytes(), digest_size=16).hexdigest()
        is_new, self._shown = key != self._shown, key
        return data_uri("image/webp", _webp(frame)) if is_new else ""


def _webp(frame: Frame) -> bytes:
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(frame).save(file, "WEBP", quality=WEBP_QUALITY, method=4)
    return file.getvalue()
