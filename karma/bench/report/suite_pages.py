"""Pages of suites: the run of a benchmark, and a figure of the policy laboratory."""

from collections.abc import Iterator
from pathlib import Path

from karma.bench.engine.benchmark_runs import read_played
from karma.bench.figures.drawing import Plot
from karma.bench.figures.tables import Sheet
from karma.bench.policies.figure import Results, caption_of, pictures_of, read_figure
from karma.bench.policies.paper_claims import claims_sheets
from karma.bench.policies.sweep import Bootstrapped
from karma.bench.report.html import fill
from karma.bench.report.page import facts_of
from karma.errors import KarmaError
from karma.journal.formats import UNKNOWN, range_text
from karma.journal.header import Header

READS = {
    "curves": (
        "Belady: the most that any policy can hit. A vertical line: from there on 95 % of the "
        "units are taken. Bands: 95 % intervals."
    ),
    "exploration": "A dot per sequence, and the straight line through them.",
}
UNITS = "Units: M is what can be carried; R4 also what it is put in or on and what is switched."


def benchmark_page(folder: Path) -> str:
    """Return the page of a benchmark's run, finished or not.

    Raises:
        FileError: the run is damaged.
        KarmaError: no episode is done yet.
    """
    header = Header.read(folder)
    benchmark, records = read_played(folder, header)
    if not records:
        raise KarmaError(
            f"{folder}: no episode is done yet\n  To fix: karma eval FILE --out {folder}"
        )
    results = benchmark.results(records)
    return fill(
        "suite.html.j2",
        title=header.name,
        notes=results.remarks,
        sheets=(results.table, *results.behind),
        pictures=benchmark.pictures(records),
        facts=facts_of(header),
    )


def figure_page(folder: Path) -> str:
    """Draw a figure of the policy laboratory and return its page.

    Raises:
        FileError: the folder has no results yet, or they are torn.
    """
    results = read_figure(folder)
    pictures = (Plot(title=name, figure=drawn) for name, drawn in pictures_of(results))
    return fill(
        "suite.html.j2",
        title=results.figure.name,
        notes=(f"{caption_of(results)}.", READS[results.figure.shows], UNITS),
        sheets=[*(sheet for _, sheet in claims_sheets(results.claims)), *_rates(results)],
        pictures=list(pictures),
        facts=(),
    )


def _rates(results: Results) -> Iterator[Sheet]:
    """Yield the hit rates of each unit set: a line per policy, a column per workload."""
    for unit_set in results.figure.unit_sets:
        cells = [cell for cell in results.cells if cell.unit_set == unit_set]
        policies = list(dict.fromkeys(row.policy for cell in cells for row in cell.sweep.rows))
        found = {(cell.workload, row.policy): row.cold for cell in cells for row in cell.sweep.rows}
        yield Sheet(
            title=f"Hit rates, {unit_set.upper()} units",
            caption="Per cent, from the empty memory on, with 95 % intervals.",
            head=("policy", *(cell.workload for cell in cells)),
            lines=tuple(
                (policy, *(_percent(found.get((cell.workload, policy))) for cell in cells))
                for policy in policies
            ),
        )


def _percent(rate: Bootstrapped | None) -> str:
    if rate is None:
        return UNKNOWN
    low, high = (None if end is None else 100 * end for end in (rate.low, rate.high))
    return range_text(100 * rate.value, low, high, 1)
