"""Share the recording and the bill of a run's hosted models.

Hosted models and recordings come with the plug-in `hosted`; without it a run measures its own
times and spends nothing.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

from karma import registry
from karma.errors import FileError, KarmaError

Mode = Literal["record", "replay", "off"]
_ADDED = ("requests", "failures", "prompt_tokens", "completion_tokens", "cost", "seconds")


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What one hosted model cost over some time; None where it is not known."""

    role: str  # planner, vision, embedder
    model: str  # as the endpoint names it
    requests: int
    failures: int  # of them, without an answer
    prompt_tokens: int | None
    completion_tokens: int | None
    cost: float | None  # in the currency of the price table; None without one
    seconds: float | None  # waited, retries included; a replay repeats what was measured


def total(parts: Iterable[float | None]) -> float | None:
    """Return a sum; None when there is nothing to add or one part is not known."""
    known = list(parts)
    return sum(p for p in known if p is not None) if known and None not in known else None


class Ledger:
    """Adds up what the hosted models of a run cost."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, str], Spent] = {}

    def enter(self, new: Spent) -> None:
        """Enter one exchange, or what was added up elsewhere."""
        if old := self._open.get((new.role, new.model)):
            sums: Any = {name: total([getattr(old, name), getattr(new, name)]) for name in _ADDED}
            new = replace(old, **sums)
        self._open[new.role, new.model] = new

    def take(self) -> tuple[Spent, ...]:
        """Return what was spent since the last time, by role and model."""
        found = tuple(self._open[key] for key in sorted(self._open))
        self._open.clear()
        return found


# ----------------------------------------------------------------- recordings


@dataclass(frozen=True, slots=True, kw_only=True)
class Tape:
    """What another process needs to join a cassette."""

    folder: Path | None = None
    mode: Mode = "off"
    token: str = ""  # of a recording


class CassetteError(FileError):
    """A cassette is missing, damaged, cannot be written, or lacks a requested exchange.

    Unlike a model's failure it is no fact about an episode: it ends the run.
    """


class Cassette(Protocol):
    """Record the exchanges and times of a run, or replay them."""

    mode: Mode
    scope: str  # the current episode; "" before the first

    @property
    def tape(self) -> Tape:
        """What another process needs to join it."""

    def begin(self, scope: str) -> None:
        """Start an episode; CassetteError where the file cannot be written."""

    def clock(self) -> float:
        """Return the seconds since the episode began; errors as in `measured`."""

    def measured(self, seconds: float) -> float:
        """Return a measured time, or in a replay the recorded one.

        CassetteError where a replay measures more often than the recording did.
        """


class NoCassette:
    """A `Cassette` that records nothing."""

    def __init__(self) -> None:
        self.mode: Mode = "off"
        self.scope = ""
        self.tape = Tape()
        self._start = time.perf_counter()

    def begin(self, scope: str) -> None:
        """Start an episode."""
        self.scope, self._start = scope, time.perf_counter()

    def clock(self) -> float:
        """Return the seconds since the episode began."""
        return time.perf_counter() - self._start

    def measured(self, seconds: float) -> float:
        """Return a measured time."""
        return seconds


def open_cassette(tape: Tape) -> Cassette:
    """Open or join a recording.

    Raises:
        CassetteError: nothing to replay, a damaged line, or another process records here.
        UnknownNameError: the plug-in `hosted` is not installed.
    """
    if tape.mode == "off":
        return NoCassette()
    opened: Cassette = registry.load("cassettes", "file")(tape)
    return opened


def cassette_of(folder: Path | None, mode: str) -> Cassette:
    """Return the cassette of a command; a folder without a mode is replayed.

    KarmaError for an unknown mode; other errors as those of `open_cassette`.
    """
    wanted = mode or ("replay" if folder is not None else "off")
    for known in get_args(Mode):
        if known == wanted:
            return open_cassette(Tape(folder=folder, mode=known))
    raise KarmaError(f"no cassette mode {mode!r}; there are {', '.join(get_args(Mode))}")


class Session:
    """What the hosted models of one run share; without a cassette every request goes out."""

    def __init__(self, cassette: Cassette | None = None) -> None:
        self.cassette: Cassette = cassette or NoCassette()
        self.ledger = Ledger()
