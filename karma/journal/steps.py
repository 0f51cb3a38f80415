"""The step log of an episode: everything that happened, a JSON line each, in its order.

The actions stand there with their exact arguments, from the last reset before the first
instruction on: reset the embedded world to the scene, do them, and it goes through the episode
again. A log is the same in every run of the same experiment. What a method did to get to know the
room is not in it: after that it resets the world.
"""

import gzip
import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from hashlib import blake2b
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import msgspec

from karma.agent.seeing.perceive import refusal
from karma.errors import FileError
from karma.files import read_bytes, to_json, unpack
from karma.journal.entries import Action, Enter, Entry, Instruction, Map
from karma.journal.folder import STEPS
from karma.types.roles import Event

_LONGEST_SLUG = 80  # characters
_ASK_ONLY = frozenset(("GetReachablePositions", "GetInteractablePoses", "GetShortestPath"))


class StepLog:
    """Collects one episode's steps; `data` are the lines."""

    def __init__(self) -> None:
        self._lines: list[bytes] = []
        self._open = False
        self._map = ""
        self.actions: list[Action] = []  # of this instruction, without questions to the world

    def reset(self) -> None:
        """The world is reset; what was done to it before `start` no longer counts."""
        if not self._open:
            self._lines.clear()

    def start(self, scene: str) -> None:
        """The method is ready; the actions so far set the episode up."""
        self._lines.insert(0, to_json(Enter(scene=scene)))
        self._open = True

    def add(self, step: Entry) -> None:
        """Write one step."""
        asks = isinstance(step, Action) and step.action in _ASK_ONLY
        if isinstance(step, Action) and not asks:
            self.actions.append(step)
        if isinstance(step, Instruction):
            self.actions = []
        if self._open or not asks:  # what is asked of a room depends on whether it is known
            self._lines.append(to_json(step))

    def watch(self, action: str, arguments: Mapping[str, Any], event: Event) -> None:
        """Write one action down."""
        why, plain = refusal(event), _as_json(arguments)
        error = why.words if why is not None else ""
        self.add(Action(action=action, arguments=plain, ok=why is None, error=error))

    def map(self, text: str) -> None:
        """Write the stable part of a prompt unless it is the last that was written."""
        if text != self._map:
            self._map = text
            self.add(Map(text=text))

    def go_back(self, before: "StepLog") -> None:
        """Hold what a copy of this log holds: what came after it never happened."""
        vars(self).update(deepcopy(vars(before)))

    def data(self) -> bytes:
        """Return the lines so far; none before `start`."""
        return b"".join(self._lines) if self._open else b""


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


def read_steps(path: Path) -> list[Entry]:
    """Read one episode's log; FileError where it is missing, or names the damaged line."""
    fix = "run it again: karma eval"
    lines = unpack(read_bytes(path, fix=fix), path=path, fix=fix).splitlines()
    decoder: msgspec.json.Decoder[Entry] = msgspec.json.Decoder(Entry)
    found = []
    for number, line in enumerate(lines, start=1):
        try:
            found.append(decoder.decode(line))
        except (msgspec.DecodeError, RecursionError) as error:
            raise FileError(path, f"line {number}: {error}") from error
    return found
