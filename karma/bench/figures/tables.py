"""Tables 1 and 2 of the paper from a run's records, beside the published figures.

A table is a `Sheet`, written as Markdown.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from karma.bench.figures.columns import (
    COLUMNS,
    OFF_ROW,
    SAVINGS,
    Figures,
    without_repeats,
)
from karma.bench.figures.compare import Comparison
from karma.bench.figures.failures import CAUSES, Failure, count
from karma.bench.figures.metrics import METRICS, SUCCESS
from karma.bench.figures.statistics import interval_text
from karma.journal.formats import UNKNOWN, figure_text, plural
from karma.journal.records import ALL, KINDS, NOT_TRAINED, TRAINED


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table in words."""

    title: str
    caption: str
    head: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


def to_markdown(tables: Sequence[Sheet]) -> str:
    """Write sheets as Markdown."""
    return "\n".join(map(_markdown, tables))


def _markdown(sheet: Sheet) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    rows = [line(sheet.head), "|" + "---|" * len(sheet.head), *map(line, sheet.lines)]
    return f"### {sheet.title}\n\n" + "\n".join(rows) + f"\n\n{sheet.caption}\n"


PUBLISHED_COLUMNS = ("success", "retrieved", "re", "rt")  # of Tables 1 and 2, by our keys


PublishedFigures = Mapping[tuple[str, str, str], float]  # (our row, kind, column)


_OURS_ALONE = ("rt_clock", "re_toured")  # beside the paper's columns, where measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The figures behind the tables of a run."""

    name: str
    figures: Sequence[Figures]
    comparisons: Sequence[Comparison]
    failures: Sequence[Failure]
    published: PublishedFigures


def sheets(result: Result) -> list[Sheet]:
    """Return all tables of a run: the paper's by kind, then details."""
    found = [*main_sheets(result), _costs(result)]
    if left_out := left_out_of(result.figures):
        found.append(_unjudged(result, left_out))
    if saving := [line for line in result.figures if line.pairs]:
        found.append(_savings(saving))
    if result.comparisons:
        found.append(comparison_sheet(result.comparisons))
    if result.failures:
        found.append(_causes(result))
    return found


def size_words(lines: Sequence[Figures]) -> str:
    """Return how much stands behind a table."""
    parts = sorted({(line.episodes, line.tasks, line.seeds) for line in lines})
    words = [
        f"{plural(episodes, 'episode')} a row ({plural(tasks, 'task')} × {plural(seeds, 'seed')})"
        for episodes, tasks, seeds in parts
    ]
    return " or ".join(words)


def main_sheets(result: Result) -> list[Sheet]:
    """Return the main tables: by kind of the paper, then for tasks of other benchmarks."""
    there = dict.fromkeys(line.kind for line in result.figures)
    found = [_main(result, kind) for kind in KINDS if kind in there]
    groups = [one for one in there if one not in (*KINDS, ALL, TRAINED, NOT_TRAINED)]
    return [*found, *([_of_others(result, groups)] if groups else [])]


def left_out_of(lines: Sequence[Figures]) -> dict[str, str]:
    """Return the tasks that are in no figure, and why."""
    return {task: why for line in lines for task, why in line.unjudged.items()}


def _unjudged(result: Result, left_out: Mapping[str, str]) -> Sheet:
    return Sheet(
        title=f"{result.name}: tasks that nobody is judged by",
        caption=(
            "No goal of these can be met in its room, whatever anybody does there. They were asked "
            "all the same, and are in no figure."
        ),
        head=("task", "why"),
        lines=tuple(left_out.items()),
    )


def _main(result: Result, kind: str) -> Sheet:
    lines = [line for line in result.figures if line.kind == kind]
    more = [key for key in _OURS_ALONE if _any_measured(lines, key)]
    head = ["method"]
    for column in PUBLISHED_COLUMNS:
        head += [COLUMNS[column].title, "published"]
    rows = []
    for line in lines:
        cells = [line.row]
        for column in PUBLISHED_COLUMNS:
            cells.append(interval_text(line.values[column]))
            there = result.published.get((line.row, kind, column))
            cells.append(UNKNOWN if there is None else f"{there:g}")
        cells += (interval_text(line.values[key]) for key in more)
        rows.append(tuple(cells))
    alone = "SR asks for every sub-task of a sequence, so read their share in the next table. "
    words = f"{alone if kind == 'sequence' else ''}{_saved_words(result)}"
    return Sheet(
        title=f"{result.name}: {kind} tasks",
        caption=(
            f"{size_words(lines)}; brackets hold 95 % intervals that keep a task's seeds together. "
            f"{words}Published: the paper, with GPT-4o on other tasks "
            "in other rooms."
        ),
        head=(*head, *(COLUMNS[key].title for key in more)),
        lines=tuple(rows),
    )


def _of_others(result: Result, groups: Sequence[str]) -> Sheet:
    """Return success on the tasks of a benchmark of others, by its lists or types of task."""
    rates = {(line.row, line.kind): line.values[SUCCESS.key] for line in result.figures}
    apart = [one for one in (TRAINED, NOT_TRAINED) if any(kind == one for _, kind in rates)]
    sizes = {line.kind: line.tasks for line in result.figures}
    lines = []
    for row in dict.fromkeys(line.row for line in result.figures):
        found = [rates.get((row, group)) for group in groups]
        known = [one.value for one in found if one is not None and one.value is not None]
        lines.append(
            (
                row,
                interval_text(rates[row, ALL]),
                figure_text(sum(known) / len(known) if len(known) == len(groups) else None),
                *(figure_text(one.value if one else None) for one in found),
                *(interval_text(rates[row, one]) for one in apart),
            )
        )
    return Sheet(
        title=f"{result.name}: our skills, another protocol",
        caption=(
            f"{size_words([line for line in result.figures if line.kind == ALL])}. Success rates "
            "of agents with this project's skills, prompts and limits, judged by the tasks' own "
            "conditions. Not to be held against scores measured by the benchmark's own protocol: "
            "its actions, limits and prompts are others. Mean: of the columns after it. Brackets: "
            f"95 % intervals that keep a task's seeds together. {_trained_words(apart)}"
        ),
        head=("method", ALL, "mean", *groups, *(f"{one} ({sizes[one]})" for one in apart)),
        lines=tuple(lines),
    )


def _trained_words(apart: Sequence[str]) -> str:
    if not apart:
        return "Whether sentences stand in the planner's training data is not known."
    return (
        "In training: sentences that stand in the data that the shipped planner was trained on, "
        "case and punctuation aside; rows that ask no planner show how hard those tasks are."
    )


def _saved_words(result: Result) -> str:
    if not any(line.pairs for line in result.figures):
        return "RE and RT need a row without memory. "
    return (
        f"RE and RT: places searched and actions saved against {OFF_ROW!r}, "
        "same task and seed; by the clock: seconds on the machine of the run. With tour: the first "
        "tour of each room counted, spread over all that the row was asked in it. "
    )


def _any_measured(lines: Sequence[Figures], key: str) -> bool:
    return any(line.values[key].value is not None for line in lines)


def _costs(result: Result) -> Sheet:
    metrics = [
        one
        for one in METRICS
        if one.key not in PUBLISHED_COLUMNS and _any_measured(result.figures, one.key)
    ]
    return _by_kind(
        result.figures,
        title=f"{result.name}: what an episode did and took",
        caption=(
            f"{size_words([line for line in result.figures if line.kind == ALL])}; "
            "sub-tasks, goals, MHR: shares; the rest: means per episode."
        ),
        head=[metric.title for metric in metrics],
        cells=lambda one: [figure_text(one.values[m.key].value, m.digits) for m in metrics],
    )


def _by_kind(
    lines: Sequence[Figures],
    *,
    title: str,
    caption: str,
    head: Sequence[str],
    cells: Callable[[Figures], Sequence[str]],
) -> Sheet:
    """Return a table with a line per row and kind, and totals if there are several kinds."""
    shown = [one for one in without_repeats(lines) if one.kind not in (TRAINED, NOT_TRAINED)]
    rows = tuple((line.row, line.kind, *cells(line)) for line in shown)
    return Sheet(title=title, caption=caption, head=("method", "tasks", *head), lines=rows)


def _savings(lines: Sequence[Figures]) -> Sheet:
    return _by_kind(
        lines,
        title=f"Saved against {OFF_ROW}",
        caption=(
            "Shares saved of what the same task and seed took without memory. Related: only in "
            "sub-tasks that come back to a thing; everybody has to search what is asked for first. "
            "Both solved: only such pairs, as an agent that gives up early also searches little. "
            "With tour: the walk through each room that made its map is spread over all "
            "instructions there; methods without a map have none."
        ),
        head=["pairs", "both solved", *(one.title for one in SAVINGS)],
        cells=lambda line: [
            str(line.pairs),
            str(line.solved_pairs),
            *(interval_text(line.values[saving.key]) for saving in SAVINGS),
        ],
    )


def comparison_sheet(comparisons: Sequence[Comparison]) -> Sheet:
    """Return success rates compared, a line per pair of arms and kind."""
    return Sheet(
        title="Success compared",
        caption=(
            "Paired by task and seed. Difference and ratio: first against second, bootstrap over "
            "tasks. p: McNemar, exact, which takes pairs as independent; p of tasks: exact too, a "
            "task's seeds kept together."
        ),
        head=(
            "first", "second", "tasks", "pairs", "SR", "SR of second", "difference", "ratio", "p",
            "p of tasks", "only one solved",
        ),
        lines=tuple(
            (
                one.first,
                one.second,
                one.kind,
                f"{one.pairs} ({one.tasks} × {len(one.seeds)})",
                figure_text(one.success.first.value),
                figure_text(one.success.second.value),
                interval_text(one.success.difference, sign=True),
                interval_text(one.ratio),
                figure_text(one.p, 3),
                figure_text(one.p_tasks, 3),
                f"{sum(len(split.seeds) for split in one.only_first)} / "
                f"{sum(len(split.seeds) for split in one.only_second)}",
            )
            for one in comparisons
        ),
    )  # fmt: skip


def _causes(result: Result) -> Sheet:
    def counts(line: Figures) -> list[str]:
        mine = [
            failure
            for failure in result.failures
            if failure.row == line.row and line.kind in (failure.kind, ALL)
        ]
        found = count(mine).values()
        return [str(sum(found)), *map(str, found)]

    return _by_kind(
        result.figures,
        title=f"{result.name}: causes of failure, the first failed sub-task of each episode",
        caption="One cause for each failed episode, by the rules of docs/metrics.md.",
        head=["failed", *CAUSES],
        cells=counts,
    )
