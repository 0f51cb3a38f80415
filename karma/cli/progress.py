"""What says who is at work, how far a command is, and what a planner is about to answer."""

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
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from karma.cli.shared import SafeConsole, console, tell

if TYPE_CHECKING:
    from rich.status import Status

    from karma.bench.engine.run import Run
    from karma.types.completion import Heard
    from karma.types.events import Plan

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


class _TimeLeft(ProgressColumn):
    """Says how long it will still take, while that is known and not over."""

    max_refresh = 0.5
    _clock = TimeRemainingColumn()

    def render(self, task: Task) -> Text:
        if task.finished or not task.time_remaining:
            return Text("")
        return Text("left ").append_text(self._clock.render(task))


def bar(*columns: ProgressColumn, passing: bool = False) -> Progress:
    """Return a bar with how many are done, of how many, since when, and the time left.

    Where nobody watches it is a line now and then, for a log. A passing one goes when all is done,
    and where nobody watches it says nothing. `columns` stand in place of the usual ones.
    """
    shown = Progress if passing or console.is_terminal else _Lines
    return shown(
        TextColumn("{task.description}"),
        BarColumn(),
        *(columns or (MofNCompleteColumn(), TimeElapsedColumn(), _TimeLeft())),
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
    """Shows the lines of answers as they come, with tokens and seconds.

    On a terminal the last ones stand at its foot until the answer is whole. Elsewhere each line
    goes to standard error when it is whole, so that standard output holds what came of it alone.
    """

    def __init__(self) -> None:
        self._errors = SafeConsole(stderr=True)
        self._status: Status | None = None
        self._number, self._before = 0, ""
        self._begin()

    def _begin(self) -> None:
        self._lines, self._cost = [""], ""

    def request(self, status: "Status") -> None:
        """Note that a request begins, whose first answer is awaited."""
        self._status, self._number, self._before = status, 0, ""
        self._begin()

    def hear(self, heard: "Heard") -> None:
        """Show what has come of an answer."""
        first = not self._cost
        many = "" if heard.tokens is None else f"{heard.tokens} tokens, "
        self._number += first
        *whole, rest = f"{self._lines[-1]}{heard.text}".split("\n")
        self._cost = f"{many}{heard.seconds:.1f} s"
        self._lines = [*self._lines[:-1], *whole, rest][-_ROWS:]
        if console.is_terminal:
            self._draw()
            return
        if first:
            self._say(f"answer {self._number}, first heard of after {heard.seconds:.1f} s:")
        for line in whole:
            self._say(f"  {line}  ({self._cost})")

    def ended(self) -> None:
        """Show what an answer ended with, where no newline came after it."""
        if not console.is_terminal and self._lines[-1]:
            self._say(f"  {self._lines[-1]}  ({self._cost})")
            self._lines[-1] = ""

    def answered(self, plan: "Plan") -> None:
        """Note that an answer was read, and why it was refused if it was."""
        self.ended()
        self._before = plan.error.partition("\n")[0]
        if self._status is not None:
            self._status.update("thinking ...")
        if not console.is_terminal and self._cost and self._before:
            self._say(f"  refused: {self._before}")
        self._begin()

    def _draw(self) -> None:
        if self._status is None:
            return
        before = f" (before: {self._before})" if self._before else ""
        rows = [f"thinking, answer {self._number}{before}: {self._cost}", *self._lines]
        wide = max(console.width - 4, 20)
        shown = [one if len(one) <= wide else f"{one[:wide]}…" for one in rows]
        self._status.update(Text("\n  ".join(one for one in shown if one)))

    def _say(self, line: str) -> None:
        self._errors.print(line, markup=False, highlight=False, soft_wrap=True)


def track(items: Iterable[T], text: str, total: int | None = None) -> Iterator[T]:
    """Yield the items, with a bar on a terminal while they are taken."""
    with bar(passing=True) as progress:
        yield from progress.track(items, total=total, description=escape(text))
