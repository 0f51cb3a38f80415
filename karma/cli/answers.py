"""Show an answer of a planner while the model is still at it."""

from typing import TYPE_CHECKING

from rich.text import Text

from karma.cli.shared import SafeConsole, console

if TYPE_CHECKING:
    from rich.status import Status

    from karma.contracts import Heard, Plan

_ROWS = 8  # of an answer under way that stay on a terminal


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
