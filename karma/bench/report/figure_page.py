"""A figure of the policy laboratory as one page: pictures, hit rates, what the paper claims."""

from collections.abc import Iterator
from pathlib import Path

from karma.agent.journal.formats import UNKNOWN, range_text
from karma.bench.figures.sheet import Sheet
from karma.bench.report.html import data_uri, fill
from karma.bench.suites.policies.figure import Results, caption_of, pictures_of, read_figure
from karma.bench.suites.policies.paper_claims import claims_sheets
from karma.bench.suites.policies.plot import svg_of
from karma.bench.suites.policies.sweep import Bootstrapped

READS = {
    "curves": (
        "Belady: the most that any policy can hit. A vertical line: from there on 95 % of the "
        "units are taken. Bands: 95 % intervals."
    ),
    "exploration": "A dot per sequence, and the straight line through them.",
}
UNITS = "Units: M is what can be carried; R4 also what it is put in or on and what is switched."


def figure_page(folder: Path) -> str:
    """Draw a figure anew and return its page.

    Raises:
        FileError: the folder has no results yet, or they are torn.
    """
    results = read_figure(folder)
    pictures = [
        {"name": name, "uri": data_uri("image/svg+xml", svg_of(picture))}
        for name, picture in pictures_of(results)
    ]
    return fill(
        "figure.html.j2",
        title=results.figure.name,
        caption=caption_of(results),
        reads=(READS[results.figure.shows], UNITS),
        pictures=pictures,
        sheets=[*(sheet for _, sheet in claims_sheets(results.claims)), *_rates(results)],
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
