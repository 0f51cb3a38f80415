"""Tables 1 and 2 of the paper from a run's records, beside the published figures.

A sheet is a table in words; it is written as Markdown or LaTeX. The CSV has the numbers themselves.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar, get_args

from karma.bench.compare import Comparison
from karma.bench.counterfactual import Reduction
from karma.bench.failures import CAUSES, Failure, count
from karma.bench.metrics import METRICS, Figures
from karma.bench.statistics import Estimate
from karma.errors import FileError
from karma.files import read_bytes

UNKNOWN = "–"
Line = TypeVar("Line", Figures, Reduction)
Column = Literal["success", "retrieved", "re", "rt"]
COLUMNS: tuple[Column, ...] = get_args(Column)
TITLES: Mapping[Column, str] = {"success": "SR", "retrieved": "MRA", "re": "RE", "rt": "RT"}
_COST_COLUMNS = (
    "subtasks_done", "goals_met", "hits", "hits_later", "explorations", "actions",
    "planner_calls", "prompt_tokens", "completion_tokens", "seconds",
    "first_token_s", "answer_s", "cost",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """One figure of the paper."""

    value: float
    source: str  # its table
    paper_row: str  # the row's name there


PublishedFigures = Mapping[tuple[str, str, str], Published]  # (our row, kind, column)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table in words."""

    title: str
    caption: str
    head: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Everything that the tables of one run are made of."""

    name: str
    figures: Sequence[Figures]
    reductions: Sequence[Reduction]  # against the memory-off twins
    paper_reductions: Sequence[Reduction]  # against the LoTa row
    comparisons: Sequence[Comparison]
    failures: Sequence[Failure]
    published: PublishedFigures


def load_published(path: Path) -> PublishedFigures:
    """Read the paper's figures.

    Raises:
        FileError: a line lacks a column, or its value is no number; names the line.
    """
    found: dict[tuple[str, str, str], Published] = {}
    try:
        text = read_bytes(path, fix="--published FILE; ours is eval/paper/published.csv").decode()
    except UnicodeDecodeError as error:
        raise FileError(path, str(error)) from error
    for number, row in enumerate(csv.DictReader(io.StringIO(text)), start=2):
        try:
            key = row["row"], row["kind"], row["metric"]
            if row["metric"] not in COLUMNS:
                raise ValueError(f"metric {row['metric']!r}; there are {', '.join(COLUMNS)}")
            found[key] = Published(
                value=float(row["value"]), source=row["source"], paper_row=row["paper_row"]
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(path, f"line {number}: {error}") from error
    return found


# ----------------------------------------------------------------- the sheets


def sheets(result: Result) -> list[Sheet]:
    """Return all tables of a run: the paper's by kind, then what stands behind them."""
    found = [_main(result, kind) for kind in kinds(result)]
    found.append(_costs(result))
    for lines, words in (
        (result.reductions, "the same task and seed without memory"),
        (result.paper_reductions, "the LoTa-Bench row, as the paper's figures seem to be"),
    ):
        if lines:
            found.append(_savings(lines, words))
    if result.comparisons:
        found.append(comparison_sheet(result.comparisons))
    if result.failures:
        found += [_causes(result, first_only=True), _causes(result, first_only=False)]
    return found


def size_words(lines: Sequence[Figures]) -> str:
    """Return how much stands behind a table."""
    parts = sorted({(line.episodes, line.tasks, line.seeds) for line in lines})
    words = [
        f"{_plural(episodes, 'episode')} a row "
        f"({_plural(tasks, 'task')} × {_plural(seeds, 'seed')})"
        for episodes, tasks, seeds in parts
    ]
    return " or ".join(words)


def kinds(result: Result) -> list[str]:
    """Return the kinds of task, in order; their sheets come first."""
    return list(dict.fromkeys(line.kind for line in result.figures if line.kind != "all"))


def _main(result: Result, kind: str) -> Sheet:
    lines = [line for line in result.figures if line.kind == kind]
    head = ["method"]
    for column in COLUMNS:
        head += [TITLES[column], "published"]
    rows = []
    for line in lines:
        cells = [line.row]
        for column in COLUMNS:
            cells.append(interval_text(estimate_of(result, line, column)))
            there = result.published.get((line.row, kind, column))
            cells.append(UNKNOWN if there is None else f"{there.value:g}")
        rows.append(tuple(cells))
    twin = result.reductions[0].reference if result.reductions else ""
    saved = (
        f"RE and RT: places searched and actions saved against {twin!r}, same task and seed. "
        if twin
        else "RE and RT need a row without memory. "
    )
    alone = (
        "SR asks for every sub-task of a sequence, so read their share in the next table. "
        if kind == "sequence"
        else ""
    )
    return Sheet(
        title=f"{result.name}: {kind} tasks",
        caption=(
            f"{size_words(lines)}; brackets hold 95 % intervals that keep a task's seeds together. "
            f"{alone}{saved}Published: the paper, with GPT-4o on other tasks in other rooms."
        ),
        head=tuple(head),
        lines=tuple(rows),
    )


def estimate_of(result: Result, line: Figures, column: Column) -> Estimate:
    """Return one of the paper's columns for a row and kind."""
    if column == "success" or column == "retrieved":
        return line.values[column]
    for one in result.reductions:
        if (one.row, one.kind) == (line.row, line.kind):
            return one.explorations if column == "re" else one.actions
    return Estimate(value=None)


def _costs(result: Result) -> Sheet:
    metrics = [
        metric
        for metric in METRICS
        if metric.key in _COST_COLUMNS
        and any(line.values[metric.key].value is not None for line in result.figures)
    ]
    rows = []
    for line in _by_kind(result.figures):
        cells = (figure_text(line.values[metric.key].value, metric.digits) for metric in metrics)
        rows.append((line.row, line.kind, *cells))
    return Sheet(
        title=f"{result.name}: what an episode did and took",
        caption=(
            f"{size_words([line for line in result.figures if line.kind == 'all'])}; "
            "sub-tasks, goals, MHR: shares; the rest: means per episode."
        ),
        head=("method", "tasks", *(metric.title for metric in metrics)),
        lines=tuple(rows),
    )


def _by_kind(lines: Sequence[Line]) -> list[Line]:
    """Return lines without those over all kinds where there is only one kind."""
    alone = len({line.kind for line in lines}) == 2
    return [line for line in lines if not (alone and line.kind == "all")]


def _savings(lines: Sequence[Reduction], words: str) -> Sheet:
    rows = tuple(
        (
            one.row,
            one.kind,
            str(one.pairs),
            interval_text(one.explorations),
            interval_text(one.actions),
            interval_text(one.seconds),
            interval_text(one.explorations_related),
            interval_text(one.actions_related),
            str(one.solved_pairs),
            interval_text(one.explorations_solved),
            interval_text(one.actions_solved),
        )
        for one in _by_kind(lines)
    )
    return Sheet(
        title=f"Saved against {lines[0].reference}",
        caption=(
            f"Shares saved of what the reference row spent: {words}. Related: only in sub-tasks "
            "that come back to a thing; what is asked for first has to be searched by everybody. "
            "Both solved: only in such pairs, as who gives up early also searches little."
        ),
        head=(
            "method", "tasks", "pairs", "RE", "RT (actions)", "RT (seconds)", "RE related",
            "RT related", "both solved", "RE of those", "RT of those",
        ),
        lines=rows,
    )  # fmt: skip


def comparison_sheet(comparisons: Sequence[Comparison]) -> Sheet:
    """Return success rates compared, a line per pair of arms and kind."""
    rows = []
    for one in comparisons:
        line = next(line for line in one.lines if line.key == "success")
        rows.append(
            (
                one.first,
                one.second,
                one.kind,
                f"{one.pairs} ({one.tasks} × {len(one.seeds)})",
                figure_text(line.first.value),
                figure_text(line.second.value),
                interval_text(line.difference, sign=True),
                interval_text(one.ratio),
                f"{one.p:.3f}",
                f"{one.p_tasks:.3f}",
                figure_text(line.detectable),
                f"{sum(len(s.seeds) for s in one.only_first)} / "
                f"{sum(len(s.seeds) for s in one.only_second)}",
            )
        )
    return Sheet(
        title="Success compared",
        caption=(
            "Paired by task and seed. Difference and ratio: first against second, bootstrap over "
            "tasks. p: McNemar, exact, which takes pairs as independent; p of tasks: exact too, a "
            "task's seeds kept together. Detectable: the smallest difference that would be found "
            "in 80 % of experiments of this size, seeds that agree counted once."
        ),
        head=(
            "first", "second", "tasks", "pairs", "SR", "SR of second", "difference", "ratio", "p",
            "p of tasks", "detectable", "only one solved",
        ),
        lines=tuple(rows),
    )  # fmt: skip


def _causes(result: Result, *, first_only: bool) -> Sheet:
    rows = []
    for line in _by_kind(result.figures):
        mine = [
            one for one in result.failures if one.row == line.row and line.kind in (one.kind, "all")
        ]
        counts = count(mine, first_only=first_only)
        rows.append((line.row, line.kind, str(sum(counts.values())), *map(str, counts.values())))
    what = "the first failed sub-task of each episode" if first_only else "every failed sub-task"
    return Sheet(
        title=f"{result.name}: causes of failure, {what}",
        caption=f"One cause for {what}, by the rules of docs/metrics.md.",
        head=("method", "tasks", "failed", *CAUSES),
        lines=tuple(rows),
    )


# ----------------------------------------------------------------- words


def figure_text(value: float | None, digits: int = 2) -> str:
    """Return a figure, or the sign for what was not measured.

    >>> figure_text(None), figure_text(0.5)
    ('–', '0.50')
    """
    return UNKNOWN if value is None else f"{value:.{digits}f}"


def interval_text(estimate: Estimate, digits: int = 2, *, sign: bool = False) -> str:
    """Return a figure with its interval."""
    if estimate.value is None:
        return UNKNOWN
    form = f"{'+' if sign else ''}.{digits}f"
    text = f"{estimate.value:{form}}"
    if estimate.interval is None:
        return text
    return f"{text} [{estimate.interval.low:{form}}, {estimate.interval.high:{form}}]"


def _plural(number: int, word: str) -> str:
    return f"{number} {word}" + ("" if number == 1 else "s")


# ----------------------------------------------------------------- files


def to_markdown(tables: Sequence[Sheet]) -> str:
    """Write sheets as Markdown."""
    return "\n".join(_markdown(sheet) for sheet in tables)


def _markdown(sheet: Sheet) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    rows = [line(sheet.head), "|" + "---|" * len(sheet.head), *map(line, sheet.lines)]
    return f"### {sheet.title}\n\n" + "\n".join(rows) + f"\n\n{sheet.caption}\n"


def to_latex(tables: Sequence[Sheet]) -> str:
    """Write sheets as LaTeX tables; they need the packages booktabs and graphicx."""
    return "% \\usepackage{booktabs,graphicx}\n" + "\n".join(_latex(sheet) for sheet in tables)


def _latex(sheet: Sheet) -> str:
    def line(cells: Sequence[str]) -> str:
        return " & ".join(map(_escaped, cells)) + r" \\"

    return "\n".join(
        (
            r"\begin{table}[t]",
            r"\centering",
            rf"\caption{{{_escaped(sheet.title)}. {_escaped(sheet.caption)}}}",
            r"\resizebox{\linewidth}{!}{%",
            rf"\begin{{tabular}}{{l{'r' * (len(sheet.head) - 1)}}}",
            r"\toprule",
            line(sheet.head),
            r"\midrule",
            *map(line, sheet.lines),
            r"\bottomrule",
            r"\end{tabular}}",
            r"\end{table}",
            "",
        )
    )


_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "–": "--", "×": r"$\times$", "<": r"$<$", ">": r"$>$", "[": "{[}", "]": "{]}",
}  # fmt: skip


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in text)


def to_csv(result: Result) -> str:
    """Write every figure of a run, one a line, with its interval and what was published."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ("row", "kind", "metric", "value", "low", "high", "episodes", "tasks", "seeds", "published")
    )
    for line in result.figures:
        values = dict(line.values) | {c: estimate_of(result, line, c) for c in ("re", "rt")}
        for key, one in values.items():
            there = result.published.get((line.row, line.kind, key))
            low_high = (one.interval.low, one.interval.high) if one.interval else (None, None)
            writer.writerow(
                (
                    line.row, line.kind, key, *(_plain(v) for v in (one.value, *low_high)),
                    line.episodes, line.tasks, line.seeds, _plain(there.value if there else None),
                )
            )  # fmt: skip
    return out.getvalue()


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
