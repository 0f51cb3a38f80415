"""The table at the end of a run, and its conclusion in words."""

from collections.abc import Iterator, Sequence

from rich.box import HORIZONTALS
from rich.markup import escape
from rich.table import Table

from karma.bench.figures.columns import COLUMNS, Figures, without_repeats
from karma.bench.figures.tables import left_out_of
from karma.journal.formats import figure_text

_FEW = 30  # episodes of a row
_NAME_WIDTH = 18  # of a row's name: the table of a run fits into 80 columns
_SHOWN = {  # in it: figure -> short title
    "success": "rate", "explorations": "places", "actions": "steps", "planner_calls": "calls",
    "seconds": "sec", "hits": "hits",
}  # fmt: skip


def summary_table(lines: Sequence[Figures], title: str) -> Table:
    """Return the table at the end of a run."""
    table = Table(title=escape(title), title_justify="left", box=HORIZONTALS, padding=(0, 1, 0, 0))
    table.add_column("row", max_width=_NAME_WIDTH, overflow="fold")
    table.add_column("tasks", no_wrap=True)
    for name in ("success", *_SHOWN.values()):
        table.add_column(name, justify="right", no_wrap=True)
    for row in dict.fromkeys(line.row for line in lines):
        group = without_repeats([line for line in lines if line.row == row])
        for line in group:
            table.add_row(
                escape(row) if line is group[0] else "",
                line.kind,
                f"{line.successes}/{line.episodes}",
                *(figure_text(line.values[key].value, COLUMNS[key].digits) for key in _SHOWN),
                end_section=line is group[-1],
            )
    table.caption = (
        "per episode: places searched, world steps, planner calls, seconds; "
        "hits: needed things found in short-term memory, cold start counted"
        + "".join(f"\n{escape(words)}" for words in _apart(lines))
    )
    return table


def _apart(lines: Sequence[Figures]) -> Iterator[str]:
    """Yield what is said of tasks that nobody is judged by, and of those that had nothing to do."""
    if left_out := left_out_of(lines):
        yield f"in no figure, as no goal can be met: {', '.join(left_out)}"
    rates = {line.row: line.values["success_to_do"].value for line in lines if line.kind == "all"}
    if told := [f"{row} {figure_text(rate)}" for row, rate in rates.items() if rate is not None]:
        yield f"rate of those with something to do when they began: {', '.join(told)}"


def conclusion(lines: Sequence[Figures]) -> str:
    """Return what two rows that were judged by as many tasks have shown; "" for other runs."""
    whole = [line for line in lines if line.kind == "all"]
    if len(whole) != 2 or whole[0].episodes != whole[1].episodes:
        return ""
    first, second = (
        f"{line.row} did {line.successes} of {line.episodes} tasks and searched "
        f"{figure_text(line.values['explorations'].value, COLUMNS['explorations'].digits)} "
        "places in each"
        for line in whole
    )
    few = "; so few show how it works, not how well" if whole[0].episodes < _FEW else ""
    return f"{first}, {second}{few}."
