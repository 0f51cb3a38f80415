"""Requests as people say them, with what was meant: read from files, and held against clauses.

`eval/requests/` holds three sets: what is to be refused, what is to be done, and sentences that
ask for several things. A clause is judged by its words, so that it may keep a pronoun or put the
name in its place, and may leave out what is no part of a request.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import msgspec

from karma.contracts import Goal
from karma.errors import FileError, KarmaError
from karma.files import read_bytes
from karma.tasks.goals import parse_goal
from karma.tasks.loose_names import singular, words_of

# Words that a clause may have or lack: they name no thing, deed, place or direction.
_SMALL = frozenset(
    words_of(
        "a an the some it its them they that this those these both each all and or then please "
        "also too to me my for you your i is are be been of with there as well again now have "
        "having had ve d ll s first next finally lastly afterwards"
    )
)


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


# ----------------------------------------------------------------- clauses against the truth


def split_right(clauses: Sequence[str], requests: Sequence[WantedClause]) -> bool:
    """Return whether clauses are the requests, in order, each whole and with none of another.

    A clause has the words of its request, in any form ("washing" is "wash"). Words that are only
    another request's it must not have; others of the sentence it may. Requests that join the one
    before may share its clause.

    >>> put = WantedClause(clause="put it away", joins=True)
    >>> wash = WantedClause(clause="wash the mug")
    >>> split_right(["wash the mug", "put the mug away"], [wash, put])
    True
    >>> split_right(["wash the mug and put it away"], [wash, put])
    True
    >>> split_right(["wash the mug and put", "it away"], [wash, put])
    False
    """
    if not clauses or not requests:
        return not clauses and not requests
    words = _stems(clauses[0])
    for end in range(1, len(requests) + 1):
        if end > 1 and not requests[end - 1].joins:
            break
        run, rest = requests[:end], requests[end:]
        if _is_run(words, run, requests) and split_right(clauses[1:], rest):
            return True
    return False


def _is_run(
    words: frozenset[str], run: Sequence[WantedClause], requests: Sequence[WantedClause]
) -> bool:
    """Return whether words are those of a run of requests, with none that is only another's."""
    needed = frozenset().union(*(_stems(one.clause) for one in run))
    allowed = needed.union(*(_stems(one.optional) for one in run))
    others = frozenset().union(*(_stems(one.clause) for one in requests if one not in run))
    return needed <= words and not words & (others - allowed)


def _stems(text: str) -> frozenset[str]:
    """Return the words of a text that say something, without their endings."""
    return frozenset(_stem(word) for word in words_of(text) if word not in _SMALL)


def _stem(word: str) -> str:
    word = singular(word)
    for ending in ("ing", "ed"):
        if word.endswith(ending) and len(word) > len(ending) + 2:
            word = word.removesuffix(ending)
            break
    word = word.removesuffix("e")
    return word[:-1] if word[-2:-1] == word[-1:] else word
