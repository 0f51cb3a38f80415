"""What people ask of a robot, of all kinds, and what was to come of it: read, and judged by truth.

`eval/requests/asked_open.jsonl` and `asked_locked.jsonl`: errands, and what is no errand. The judge
looks at the world, never at the agent's own goals.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec

from karma.goals.files import load_lines
from karma.goals.goals import parse_goal
from karma.types.tasks import Goal

Act = Literal["do", "partly", "ask", "refuse", "answer"]  # what is to come of it
Came = Literal["done", "partly", "unfinished", "refused", "asked", "answered"]  # by the agent
Verdict = Literal[
    "right", "asked rightly", "refused rightly", "refused or asked wrongly", "wrong and said so",
    "wrong and said done",
]  # fmt: skip
VERDICTS: tuple[Verdict, ...] = (
    "right", "asked rightly", "refused rightly", "refused or asked wrongly", "wrong and said so",
    "wrong and said done",
)  # fmt: skip
_STATES = (
    "isOpen", "isToggled", "isDirty", "isSliced", "isBroken", "isCooked", "isFilledWithLiquid",
    "isUsedUp", "isPickedUp", "parentReceptacles",
)  # fmt: skip


class AskedRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing said to a robot that knows a room."""

    id: str
    kind: str
    scene: str
    text: str
    act: Act
    goals: tuple[str, ...] = ()  # of "do" and "partly": what holds in the end
    never: tuple[str, ...] = ()  # what must not hold in the end
    answers: tuple[str, ...] = ()  # of a question: words of which the answer has at least one

    def __post_init__(self) -> None:
        """Raise KarmaError where a goal cannot be read."""
        _ = self.wanted, self.unwanted

    @property
    def wanted(self) -> tuple[Goal, ...]:
        """What holds in the end."""
        return tuple(parse_goal(goal) for goal in self.goals)

    @property
    def unwanted(self) -> tuple[Goal, ...]:
        """What must not hold in the end."""
        return tuple(parse_goal(goal) for goal in self.never)


def states_of(objects: Sequence[Mapping[str, Any]]) -> dict[str, tuple[Any, ...]]:
    """Return what of a world's objects a deed changes: id -> states, and what they are in or on."""
    return {one["objectId"]: tuple(str(one.get(key)) for key in _STATES) for one in objects}


def verdict(
    asked: AskedRequest, came: Came, *, met: bool, changed: bool, said: str = ""
) -> Verdict:
    """Return what a request came to.

    Args:
        asked: the request.
        came: what the agent says came of it.
        met: all that was wanted holds, and nothing that was not.
        changed: something in the room is not as it was.
        said: the reply in words.
    """
    silent = came in ("refused", "asked", "answered") and not changed
    rightly: Verdict = "asked rightly" if came == "asked" else "refused rightly"
    if asked.answers and silent:
        words = re.findall(r"[a-z0-9]+", said.lower())
        told = any(" " + answer + " " in " " + " ".join(words) + " " for answer in asked.answers)
        return "right" if came == "answered" and told else "refused or asked wrongly"
    if asked.act == "do":
        if silent and met and came == "answered":  # nothing was to be done
            return "right"
        if silent:
            return "refused or asked wrongly"
        if came == "done":
            return "right" if met else "wrong and said done"
        return "wrong and said so"
    if came == "done":
        return "wrong and said done"
    if silent:
        return rightly
    return "right" if asked.act == "partly" and met else "wrong and said so"


# ----------------------------------------------------------------- several in a sentence


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


def load_several(path: str | Path) -> tuple[SeveralRequests, ...]:
    """Read sentences with their requests, one a line.

    Raises:
        FileError: a line is none, or has a goal that cannot be read; names the line.
    """
    return load_lines(path, SeveralRequests)
