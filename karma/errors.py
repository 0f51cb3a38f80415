"""The errors a caller can act on; every message names what is wrong, where, and what helps."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import ClassVar


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the sentence that suggests the nearest known name, " " before it; "" if none is near.

    >>> did_you_mean("kichen_1", ["kitchen_1", "bedroom_2"]), did_you_mean("x", ["kitchen_1"])
    (" Did you mean 'kitchen_1'?", '')
    """
    folded = {one.lower(): one for one in known}
    near = get_close_matches(name.lower(), folded, n=1)
    return f" Did you mean {folded[near[0]]!r}?" if near else ""


class KarmaError(Exception):
    """Anything this package refuses to do.

    Whose fault one is in an episode is said by its class. One of the agent's own ends the episode,
    which has failed. Any other (a file, a model, a server, a simulator, a bug) ends the run, which
    says so and counts nothing; the same command does the episode again.
    """

    agents_own: ClassVar[bool] = False


class FileError(KarmaError):
    """A file is missing, torn, of the wrong form, or cannot be written.

    Args:
        path: the file.
        reason: what is wrong with it, and where in it.
        fix: the command or step that helps, if one is known.
    """

    def __init__(self, path: str | Path, reason: str, *, fix: str | None = None) -> None:
        super().__init__(f"{path}: {reason}" + (f"\n  To fix: {fix}" if fix else ""))
        self.path, self.reason, self.fix = Path(path), reason, fix


class UnwritableError(FileError):
    """A file cannot be written: the disk is full or read-only; nobody's fault but the machine's."""


class UnknownNameError(KarmaError):
    """A name that nothing is registered under; the message suggests the nearest."""


class ModelError(KarmaError):
    """A model cannot be used: missing, wrong hash, damaged, or of the wrong kind."""


class RequestRefused(ModelError):
    """A model that works does not take what it was asked, e.g. longer than its context."""

    agents_own = True


class ServerLost(ModelError):
    """A hosted model cannot be reached or takes no more."""


class ProgramError(KarmaError):
    """The planner's text uses something outside the skill API.

    Args:
        reason: what is refused.
        line: line number in the text, from 1.
        code: that line; quoted in the retry prompt.
    """

    agents_own = True

    def __init__(self, reason: str, *, line: int, code: str) -> None:
        super().__init__(f"line {line}: {reason}\n    {code}")
        self.reason, self.line, self.code = reason, line, code


class WorkerLost(KarmaError):
    """An episode ends every process that does it.

    Args:
        episode: row, task and seed.
        reason: what became of the processes.
    """

    def __init__(self, episode: str, reason: str) -> None:
        super().__init__(
            f"episode {episode} cannot be done: {reason}\n"
            "  To fix: give it more memory, or fewer --workers; the same command does it again"
        )


class WorldLost(KarmaError):
    """The simulator's process has died, hangs, or no longer makes sense; `reset` starts another.

    Args:
        reason: what became of it.
        during: the action that waited for it, or "start".
        log: where its output went.
        tail: the last lines of that output.
    """

    def __init__(self, reason: str, *, during: str, log: str | Path, tail: str = "") -> None:
        said = f"\n  It said:\n{tail}" if tail else ""
        super().__init__(
            f"the simulator is lost, during {during}: {reason}\n  Its output: {log}{said}\n"
            "  To go on: reset(scene) starts another; `karma doctor thor` looks for causes"
        )
        self.reason, self.during, self.log = reason, during, Path(log)
