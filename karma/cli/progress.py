"""Progress of a command: its workers, how far it is, and the answer under way."""

from collections.abc import Iterable, Iterator
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from karma.cli.shared import console, tell

if TYPE_CHECKING:
    from rich.status import Status

    from karma.bench.engine.run import Run
    from karma.types.completion import Heard

T = TypeVar("T")
_LINE_S = 10.0  # between lines of a log
_ROWS = 8  # of an answer under way that stay on a terminal


class _Lines(Progress):
    """Says how far it is in lines, the last one when all is done."""

    _told_s, _said = -inf, ""

    def start(self) -> None:
        pass

    def stop(self) -> None:
        for task in self.tasks:
            self._tell(task.id)

    def update(self, task_id: TaskID, **fields: Any) -> None:
        super().update(task_id, **fields)
        if monotonic() - self._told_s >= _LINE_S:
            self._tell(task_id)

    def _tell(self, task_id: TaskID) -> None:
        task = self._tasks[task_id]
        total = "" if task.total is None else f" of {task.total:g}"
        said = f"{task.completed:g}{total}: {task.description}"
        if said != self._said:
            self._said, self._told_s = said, monotonic()
            console.print(said, highlight=False, soft_wrap=True)


def bar(*columns: ProgressColumn, passing: bool = False) -> Progress:
    """Return a bar with how many are done, of how many, since when, and the time left.

    Where nobody watches it is a line now and then, for a log. A passing one goes when all is done,
    and where nobody watches it says nothing. `columns` stand in place of the usual ones.
    """
    shown = Progress if passing or console.is_terminal else _Lines
    return shown(
        TextColumn("{task.description}"),
        BarColumn(),
        *(columns or (MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())),
        console=console,
        transient=passing,
        disable=passing and not console.is_terminal,
    )


def workers_for(run: "Run", workers: int, ray: str) -> int:
    """Say who does what is left of a run, and return how many workers to use.

    0 workers are as many as there is room for on the machine, or on the Ray cluster.
    """
    if run.left and ray:
        many = workers or "as many workers as it has room for"
        tell(f"on the Ray cluster at {ray}: {many}")
    elif run.left and not workers:
        suggested = run.suggest()
        workers = suggested.number
        tell(f"workers: {workers} ({suggested.reason})")
    return workers


class AnswerView:
    """Shows the last lines of an answer on a terminal while it comes, with tokens and seconds."""

    def __init__(self) -> None:
        self._status: Status | None = None
        self._number, self._text = 0, ""

    def request(self, status: "Status") -> None:
        """Note that a request begins, whose first answer is awaited."""
        self._status, self._number, self._text = status, 1, ""

    def hear(self, heard: "Heard") -> None:
        """Show the part of an answer that has come."""
        self._text += heard.text
        if self._status is not None:
            tokens = "" if heard.tokens is None else f"{heard.tokens} tokens, "
            head = f"thinking, answer {self._number}: {tokens}{heard.seconds:.1f} s"
            shown = [line for line in self._text.split("\n") if line][-_ROWS:]
            rows = Text("\n  ".join([head, *shown]), no_wrap=True, overflow="ellipsis")
            self._status.update(rows)

    def answered(self) -> None:
        """Note that the answer is whole; another may follow."""
        self._number, self._text = self._number + 1, ""
        if self._status is not None:
            self._status.update("thinking ...")


def track(items: Iterable[T], text: str, total: int | None = None) -> Iterator[T]:
    """Yield the items, with a bar on a terminal while they are taken."""
    with bar(passing=True) as progress:
        yield from progress.track(items, total=total, description=escape(text))
