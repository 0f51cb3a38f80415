"""Several runs or the cells of a sweep on one page, with the figures of `karma compare`."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from urllib.parse import quote

from karma.agent.journal.formats import UNKNOWN, figure_text, range_text
from karma.agent.journal.owned_folder import STEPS, kind_in
from karma.agent.journal.records import ALL
from karma.agent.journal.run_folder import RunData, read_run
from karma.bench.engine.sweep_folder import read_sweep
from karma.bench.figures.columns import COLUMNS, Figures, figures
from karma.bench.figures.compare import compare_kinds, rows_of
from karma.bench.figures.metrics import Metric
from karma.bench.figures.results import Side, check_same_rooms, split_name
from karma.bench.report.html import fill
from karma.bench.report.results import (
    Plot,
    ResultLine,
    TaskLine,
    columns,
    episode_key,
    result_lines,
    success_plot,
    task_lines,
)
from karma.errors import KarmaError

PAGE = "report.html"  # of each run, in its folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Against:
    """A success rate beside the reference's, over the pairs that both have."""

    text: str
    span: str = ""
    p: str = UNKNOWN
    pairs: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonPage:
    """What the template says."""

    title: str
    reference: str
    sides: tuple[str, ...]
    columns: tuple[Metric, ...]
    lines: tuple[ResultLine, ...]
    against: Mapping[tuple[str, str], Against]  # by side and kind
    plot: Plot
    tasks: tuple[TaskLine, ...]
    links: Mapping[str, str]  # address of each side's page
    steps: frozenset[str]  # sides whose episodes may be stepped through
    keys: Mapping[tuple[str, str, int], str]  # side, task, seed -> what names it on that page
    notes: tuple[str, ...]


def sides_of(names: Sequence[str]) -> tuple[list[Side], list[str]]:
    """Return what stands side by side, and in words what does not.

    Names are folders of runs or sweeps, or RUN:ROW.

    Raises:
        FileError: there is no run, or it is damaged.
        KarmaError: nothing is done yet, no such row, or rooms of one name differ.
    """
    sides: list[Side] = []
    notes: list[str] = []
    for name in names:
        folder, row = split_name(name)
        if kind_in(folder) == "sweep":
            found, missing = _cells(folder)
            notes += missing
        else:
            found = [(str(folder) if len(names) > 1 else folder.name, read_run(folder))]
        for label, run in found:
            rows = rows_of(run.records)
            if row and row not in rows:
                raise KarmaError(
                    f"{folder}: no row {row!r}; there are {', '.join(map(repr, rows))}"
                )
            if not run.finished:
                notes.append(f"{label}: not finished, {len(run.records)} episodes are done")
            sides += [
                Side(name=f"{label}: {one}", run=run, row=one) for one in rows if row in ("", one)
            ]
    if not sides:
        raise KarmaError("no episode is done yet\n  To fix: karma eval FILE")
    check_same_rooms([one.run for one in sides])
    return _short(sides), notes


def _cells(folder: Path) -> tuple[list[tuple[str, RunData]], list[str]]:
    data = read_sweep(folder)
    found, missing = [], []
    for cell in data.cells:
        run = data.run(cell)
        if cell.failed:
            missing.append(f"{cell.name}: failed: {' '.join(cell.failed.split())}")
        if run is not None:
            found.append((cell.name, run))
        elif not cell.failed:
            missing.append(f"{cell.name}: not begun")
    return found, missing


def _short(sides: list[Side]) -> list[Side]:
    """Return the sides without what all of their names have in common, where that leaves a name."""
    if len({one.row for one in sides}) == 1 and len({one.run.folder for one in sides}) > 1:
        return [replace(one, name=one.name.removesuffix(f": {one.row}")) for one in sides]
    return sides


def chosen_reference(sides: Sequence[Side], wanted: str) -> Side:
    """Return the side that all others are held against: the first unless another is named.

    Raises:
        KarmaError: no side, or more than one, has that name; names the nearest.
    """
    if not wanted:
        return sides[0]
    found = [one for one in sides if wanted == one.name]
    found = found or [one for one in sides if wanted in (one.row, str(one.run.folder))]
    if len(found) == 1:
        return found[0]
    near = get_close_matches(wanted, [one.name for one in sides], n=1, cutoff=0.3)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise KarmaError(
        f"--reference {wanted!r}: {'several have' if found else 'none has'} that name.{hint}\n"
        f"  To fix: one of {', '.join(repr(one.name) for one in sides)}"
    )


def comparison_of(
    title: str, sides: Sequence[Side], reference: Side, notes: Sequence[str], out: Path
) -> Iterator[float | ComparisonPage]:
    """Yield now and then the share that is done, in [0, 1], and at last what the page says.

    Notes say what is not on the page; links lead from `out`, where the page will lie.
    """
    lines: list[Figures] = []
    against: dict[tuple[str, str], Against] = {}
    said = list(notes)
    for number, side in enumerate(sides):
        yield number / len(sides)
        mine = _figures(side)
        lines += mine
        if side is reference:
            continue
        try:
            against |= _against(side, reference, {line.kind for line in mine})
        except KarmaError as error:
            said.append(f"{side.name}: no difference: {' '.join(str(error).split())}")
    records = [
        replace(record, row=side.name)
        for side in sides
        for record in side.run.records
        if record.row == side.row
    ]
    yield ComparisonPage(
        title=title,
        reference=reference.name,
        sides=tuple(side.name for side in sides),
        columns=columns(lines),
        lines=result_lines(lines),
        against=against,
        plot=success_plot(lines),
        tasks=task_lines(records),
        links={side.name: _link(side.run.folder / PAGE, out) for side in sides},
        steps=frozenset(one.name for one in sides if (one.run.folder / STEPS).is_dir()),
        keys={
            (side.name, one.task, one.seed): episode_key(one)
            for side in sides
            for one in side.run.records
            if one.row == side.row
        },
        notes=tuple(said),
    )


def render_comparison(page: ComparisonPage) -> str:
    """Return the page as HTML."""
    return fill(
        "comparison.html.j2",
        columns=len(page.sides),
        letters=min(40, max(len(line.task) for line in page.tasks)),
        page=page,
        figure=figure_text,
        sr=COLUMNS["success"].says,
    )


def _figures(side: Side) -> list[Figures]:
    """Return a side's figures as its own run's tables have them, under the side's name."""
    lines = figures(side.run.records, side.run.timings)
    return [replace(line, row=side.name) for line in lines if line.row == side.row]


def _against(side: Side, reference: Side, kinds: set[str]) -> dict[tuple[str, str], Against]:
    found = compare_kinds(side.arm(side.row), reference.arm(reference.row))
    by_kind = {one.kind: one for one in found}
    if len(found) == 1:
        by_kind[ALL] = found[0]
    told = {}
    for kind in kinds & by_kind.keys():
        one = by_kind[kind]
        gap = one.success.difference
        span = ""
        if gap.interval is not None:
            span = f"{gap.interval.low:+.2f} to {gap.interval.high:+.2f}".replace("-", "−")
        told[side.name, kind] = Against(
            text=range_text(gap.value, None, None, 2, sign=True).replace("-", "−"),
            span=span,
            p=figure_text(one.p_tasks, 3),
            pairs=one.pairs,
        )
    return told


def _link(page: Path, out: Path) -> str:
    """Return a page's address as seen from another; no name in it can be taken for a scheme."""
    away = os.path.relpath(page.absolute(), out.absolute().parent)
    return "./" + quote(Path(away).as_posix())
