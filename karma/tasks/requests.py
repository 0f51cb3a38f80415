"""Requests as people say them, with what was meant, read from files.

`eval/requests/` holds three sets: what is to be refused, what is to be done, and sentences that
ask for several things.
"""

from pathlib import Path
from typing import TypeVar

import msgspec

from karma.contracts import Goal
from karma.errors import FileError, KarmaError
from karma.files import read_bytes
from karma.tasks.goals import parse_goal


class SaidRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing said to a robot that knows a room, with nothing or something handled before."""

    id: str
    kind: str  # how it is said; of one to be refused, why
    scene: str
    text: str
    goals: tuple[str, ...] = ()  # none: it is to be refused
    handled: tuple[str, ...] = ()  # types of things handled before, the last used last

    def __post_init__(self) -> None:
        """Raise KarmaError where a goal cannot be read."""
        _ = self.wanted

    @property
    def wanted(self) -> tuple[Goal, ...]:
        """What must hold when it is done."""
        return tuple(parse_goal(goal) for goal in self.goals)


class WantedClause(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One request of a sentence: its words, and what must hold when it is done."""

    clause: str
    goals: tuple[str, ...] = ()
    optional: str = ""  # words of the sentence that its clause may have
    joins: bool = False  # it may stay in one clause with the request before it

    def __post_init__(self) -> None:
        """Raise KarmaError where a goal cannot be read."""
        _ = self.wanted

    @property
    def wanted(self) -> tuple[Goal, ...]:
        """What must hold when it is done."""
        return tuple(parse_goal(goal) for goal in self.goals)


class SeveralRequests(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A sentence and the requests in it, in the order in which they are to be done."""

    id: str
    kind: str
    scene: str
    text: str
    requests: tuple[WantedClause, ...]


class _Text(msgspec.Struct, frozen=True, kw_only=True):
    id: str
    text: str


_Row = TypeVar("_Row", SaidRequest, SeveralRequests, _Text)


def load_said(path: str | Path) -> tuple[SaidRequest, ...]:
    """Read requests of one thing each, one a line.

    Raises:
        FileError: a line is none, or has a goal that cannot be read; names the line.
    """
    return _load(path, SaidRequest)


def load_several(path: str | Path) -> tuple[SeveralRequests, ...]:
    """Read sentences with their requests, one a line.

    Raises:
        FileError: a line is none, or has a goal that cannot be read; names the line.
    """
    return _load(path, SeveralRequests)


def load_texts(path: str | Path) -> tuple[str, ...]:
    """Read what is said in a file of requests of either kind, one a line.

    Raises:
        FileError: a line has no text; names the line.
    """
    return tuple(one.text for one in _load(path, _Text))


def _load(path: str | Path, row: type[_Row]) -> tuple[_Row, ...]:
    found: dict[str, _Row] = {}
    for number, line in enumerate(read_bytes(path).splitlines(), start=1):
        try:
            one = msgspec.json.decode(line, type=row)
        except (KarmaError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise FileError(path, f"line {number}: {error}") from error
        if one.id in found:
            raise FileError(path, f"line {number}: id: {one.id!r} stands twice")
        found[one.id] = one
    return tuple(found.values())
