"""What a person sees in the terminal: an instruction being carried out, and tables of figures."""

from collections.abc import Iterator, Sequence
from textwrap import wrap

from rich.box import HORIZONTALS
from rich.markup import escape
from rich.table import Table

from karma.bench.figures.columns import COLUMNS, Figures, without_repeats
from karma.bench.figures.tables import left_out_of
from karma.journal.formats import UNKNOWN, figure_text
from karma.journal.records import EpisodeRecord

_FEW = 30  # episodes of a row
_NAME_WIDTH = 18  # of a row's name: the table of a run fits into 80 columns
_SHOWN = {  # in it: figure -> short title
    "success": "rate", "explorations": "places", "actions": "steps", "planner_calls": "calls",
    "seconds": "sec", "hits": "hits",
}  # fmt: skip


def summary_table(lines: Sequence[Figures], title: str) -> Table:
    """Return the table at the end of a run."""
    table = Table(title=escape(title), title_justify="left", box=HORIZONTALS, padding=(0, 1, 0, 0))
    table.add_column("row")
    table.add_column("tasks", no_wrap=True)
    for name in ("success", *_SHOWN.values()):
        table.add_column(name, justify="right", no_wrap=True)
    for row in dict.fromkeys(line.row for line in lines):
        group = without_repeats([line for line in lines if line.row == row])
        for line, words in zip(group, _spread(row, len(group)), strict=True):
            table.add_row(
                escape(words),
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


def _spread(name: str, lines: int) -> list[str]:
    """Return a long name in pieces, one for each line of a group; what is over stays in the last.

    >>> _spread("KARMA (w/o short term memory)", 4)
    ['KARMA (w/o short', 'term memory)', '', '']
    >>> _spread("HELPER (furniture in the prompt)", 1)[0].splitlines()
    ['HELPER (furniture', 'in the prompt)']
    """
    pieces = wrap(name, _NAME_WIDTH)
    pieces[lines - 1 :] = ["\n".join(pieces[lines - 1 :])]
    return pieces + [""] * (lines - len(pieces))


def task_table(records: Sequence[EpisodeRecord]) -> Table:
    """Return one line per task: resolved or not, and each row's success."""
    rows = list(dict.fromkeys(record.row for record in records))
    table = Table(title="per task", title_justify="left")
    for name in ("task", "scene", "goals", *rows):
        table.add_column(escape(name))
    table.caption = (
        "goals: how many could be resolved, of all; a task is judged by those, and by none where "
        "there are none; apart: no words ask for them, so they judge nobody; ✗: how many of those "
        "were met; at start: all of them held when it began"
    )
    table.add_column("notes", overflow="fold")
    by_task: dict[str, dict[str, EpisodeRecord]] = {}  # of each row the last seed
    for record in records:
        by_task.setdefault(record.task, {})[record.row] = record
    for task, found in by_task.items():
        one = max(found.values(), key=_goals)  # an error ends a record early
        goals = _goals(one)
        table.add_row(
            escape(task),
            escape(one.scene),
            _resolved(goals, one.notes),
            *(_mark(found.get(row), goals) for row in rows),
            "\n".join(escape(note) for note in one.notes) or "",
        )
    return table


def _resolved(judged: int, notes: Sequence[str]) -> str:
    """Return how many goals judge a task, of how many, and how many no words ask for."""
    lost, apart = (
        sum(note.startswith(word) for note in notes) for word in ("unresolved ", "unasked ")
    )
    return f"{judged} of {judged + lost}" + (f", {apart} apart" if apart else "")


def _goals(record: EpisodeRecord) -> int:
    return sum(len(sub.goals) for sub in record.subtasks)


def _mark(record: EpisodeRecord | None, goals: int) -> str:
    """Return whether a task was solved; if not, how many of its goals were met."""
    if record is None or record.unjudged:
        return UNKNOWN
    if record.success:
        return "[green]✓[/]" if record.to_do else "[green]✓[/] at start"
    met = sum(len(sub.goals) - len(sub.unmet) for sub in record.subtasks)
    return f"[red]✗[/] {met}/{goals}"
