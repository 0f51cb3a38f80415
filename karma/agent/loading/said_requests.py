"""Requests as people say them, with what was meant, read from files.

`eval/requests/` holds sets of what is to be refused, and of what is to be done.
"""

from pathlib import Path
from typing import TypeVar

import msgspec

from karma.agent.goals.goals import parse_goal
from karma.contracts import Goal
from karma.errors import FileError, KarmaError
from karma.files import read_bytes


class SaidLine(msgspec.Struct, frozen=True, kw_only=True):
    """One line: what is said, and what names it."""

    id: str
    text: str


class SaidRequest(SaidLine, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing said to a robot that knows a room, with nothing or something handled before."""

    kind: str  # how it is said; of one to be refused, why
    scene: str
    goals: tuple[str, ...] = ()  # none: it is to be refused
    handled: tuple[str, ...] = ()  # types of things handled before, the last used last

    def __post_init__(self) -> None:
        """Raise KarmaError where a goal cannot be read."""
        _ = self.wanted

    @property
    def wanted(self) -> tuple[Goal, ...]:
        """What must hold when it is done."""
        return tuple(parse_goal(goal) for goal in self.goals)


_Row = TypeVar("_Row", bound=SaidLine)


def load_said(path: str | Path) -> tuple[SaidRequest, ...]:
    """Read requests of one thing each; FileError names a line that is none."""
    return load_lines(path, SaidRequest)


def load_texts(path: str | Path) -> tuple[str, ...]:
    """Read what is said in a file of requests of either kind; errors as `load_said`."""
    return tuple(one.text for one in load_lines(path, SaidLine))


def load_lines(path: str | Path, row: type[_Row]) -> tuple[_Row, ...]:
    """Read lines of any kind; errors as in `load_said`."""
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
