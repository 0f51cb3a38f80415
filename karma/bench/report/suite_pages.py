"""Pages of suites: a run of lived-in homes, and a figure of the policy laboratory.

The first has figures, requests, and a day lived again on the map; the second pictures, hit rates,
and what the paper claims.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from karma.agent.journal.formats import UNKNOWN, range_text
from karma.agent.journal.header import BenchmarkHeader
from karma.bench.engine.benchmark_runs import read_played
from karma.bench.figures.tables import Sheet
from karma.bench.policies.figure import Results, caption_of, pictures_of, read_figure
from karma.bench.policies.paper_claims import claims_sheets
from karma.bench.policies.plot import empty, svg_of
from karma.bench.policies.sweep import Bootstrapped
from karma.bench.report.html import data_uri, fill, script_data
from karma.bench.report.page import columns_of, facts_of
from karma.bench.report.room import plan_of
from karma.errors import KarmaError, did_you_mean
from karma.plugins.homes.lived.benchmark import LivedHomes
from karma.plugins.homes.lived.report_day import WALK_S, day_name, told_day
from karma.plugins.homes.lived.request import DAY_S, LivedRecord
from karma.plugins.homes.lived.table import (
    ALL,
    KINDS,
    OURS,
    LivedFigures,
    StaleShare,
    by_day,
    figures_of,
    stale_shares,
)
from karma.plugins.homes.lived.trace import HomeTrace

NAMED = 6  # homes in a message
DRAWN_CM = 800.0  # of a home, at which marks have their usual size


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedRun:
    """A run of lived-in homes as it was read."""

    folder: Path
    header: BenchmarkHeader
    benchmark: LivedHomes
    records: tuple[LivedRecord, ...]


class LivedDay(NamedTuple):
    """The day that the page replays."""

    record: LivedRecord
    trace: HomeTrace


def read_lived(folder: Path) -> LivedRun:
    """Read a run, finished or not; KarmaError where it is torn, or no day is done."""
    header = BenchmarkHeader.read(folder)
    benchmark, records = read_played(folder, header)
    if not records:
        raise KarmaError(f"{folder}: no day is done yet\n  To fix: karma eval FILE --out {folder}")
    assert isinstance(benchmark, LivedHomes)
    return LivedRun(folder=folder, header=header, benchmark=benchmark, records=tuple(records))


def home_of_record(record: LivedRecord) -> str:
    """Return the name of a record's home, "usual/home_003"."""
    return record.task.rpartition("/")[0]


def chosen_day(run: LivedRun, home: str = "", day: int | None = None, row: str = "") -> LivedRecord:
    """Return the day that is wanted; what is left open is the first that was served wrongly.

    A home is such as "usual/home_003"; of the rows ours is taken, or the first.

    Raises:
        KarmaError: the run has none such.
    """
    rows = list(dict.fromkeys(one.row for one in run.records))
    homes = list(dict.fromkeys(home_of_record(one) for one in run.records))
    row = row or (OURS if OURS in rows else rows[0])
    _check("--row", row, rows, run.folder)
    if home:
        _check("--home", home, homes, run.folder)
    mine = [one for one in run.records if one.row == row and home in ("", home_of_record(one))]
    if not mine:
        fix = f"karma eval FILE --out {run.folder}"
        raise KarmaError(f"{run.folder}: {row!r} was not yet in {home}\n  To fix: {fix}")
    found = [one for one in mine if day in (None, one.day)]
    if not found:
        days = sorted({one.day for one in mine})
        raise KarmaError(
            f"{run.folder}: --day {day}: {row!r} has days {days[0]} to {days[-1]}\n"
            f"  To fix: karma report {run.folder} --day {days[0]}"
        )
    played = [one for one in found if not one.error]
    if not played:
        raise KarmaError(
            f"{run.folder}: {found[0].task} of {row!r} was lost: {found[0].error}\n"
            f"  To fix: karma eval FILE --out {run.folder} --fresh"
        )
    return next((one for one in played if not one.success), played[0])


def _check(option: str, value: str, known: Sequence[str], folder: Path) -> None:
    if value not in known:
        more = f" and {len(known) - NAMED} more" if len(known) > NAMED else ""
        raise KarmaError(
            f"{folder}: {option} {value!r}: there is none in the run.{did_you_mean(value, known)} "
            f"It has {', '.join(known[:NAMED])}{more}\n"
            f"  To fix: karma report {folder} {option} '{known[0]}'"
        )


def lived_again(
    run: LivedRun, record: LivedRecord, *, after_day: Callable[[], object] = lambda: None
) -> LivedDay:
    """Live a home again up to a day; KarmaError where what comes out is not what the run says."""
    chain = next(
        one
        for one in run.benchmark.chains()
        if one.row == record.row and one.seed == record.seed and record.task in one.tasks
    )
    records, trace = run.benchmark.trace(chain, record.day + 1, after_day=after_day)
    kept = {one.day: one for one in run.records if (one.row, one.task, one.seed) in chain.keys}
    for one in records:
        said = kept.get(one.day, one)
        if said != one:
            names = [f.name for f in fields(one) if getattr(one, f.name) != getattr(said, f.name)]
            versions = ", ".join(f"{name} {found}" for name, found in run.header.versions.items())
            raise KarmaError(
                f"{run.folder}: {one.task} of {one.row!r}, lived again, is not as the run says: "
                f"{', '.join(names)} differ; it was made by {versions}, or its files have "
                f"changed since\n  To fix: karma eval FILE --out {run.folder} --fresh"
            )
    return LivedDay(record, trace)


def render_lived(run: LivedRun, shown: LivedDay) -> str:
    """Return the page."""
    results = run.benchmark.results(run.records)
    record = shown.record
    pictures = list(lived_pictures(results.figures, stale_shares(run.records)))
    if len({one.setting for one in run.records}) == 1 and len({one.day for one in run.records}) > 1:
        days = by_day(run.records)
        pictures.append(curves_picture("Over days lived", figures_of(days), stale_shares(days)))
    sheets: tuple[Sheet, ...] = (results.table, *results.behind)
    plan = plan_of(shown.trace.scene, None)
    return fill(
        "lived.html.j2",
        script="lived.js.j2",
        title=run.header.name,
        record=record,
        home=home_of_record(record),
        day=day_name(record.day),
        rows=list(dict.fromkeys(one.row for one in run.records)),
        homes=len({(home_of_record(one), one.seed) for one in run.records}),
        days=len(run.records),
        requests=sum(len(one.requests) for one in run.records),
        pictures=[
            {"title": one.title, "caption": one.caption, "uri": one.uri()} for one in pictures
        ],
        sheets=sheets,
        remarks=results.remarks,
        facts=tuple(facts_of(run.header)),
        plan=plan,
        walk_s=round(WALK_S),
        data=script_data(
            {
                "row": record.row,
                "task": record.task,
                "seed": record.seed,
                "scale": max(1.0, max(map(float, plan.view_box.split()[2:])) / DRAWN_CM),
                "requests": columns_of(_listed(run.records)),
                "day": told_day(shown.trace, record.day),
            }
        ),
    )


def _listed(records: Sequence[LivedRecord]) -> list[dict[str, Any]]:
    """Return all requests as lines of the list."""
    return [
        {
            "row": record.row,
            "task": record.task,
            "seed": record.seed,
            "time": round(one.time_s - record.day * DAY_S),
            "kind": one.kind,
            "text": one.text,
            "right": one.right,
            "unknown": one.unknown,
            "actions": one.actions,
            "stale": one.stale,
        }
        for record in records
        for one in record.requests
    ]


WIDTH = 0.8  # of all rows of one kind, beside each other
HARD = (ALL, "changed", "several", "event")  # kinds that the curves show
STALE = "stale actions"
LEAST = 10  # chances of a tenth that is drawn


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedPicture:
    """One picture with its words."""

    title: str
    caption: str
    figure: Any  # of matplotlib

    def uri(self) -> str:
        """Return it as an address that holds it."""
        return data_uri("image/svg+xml", svg_of(self.figure))


def lived_pictures(
    figures: Sequence[LivedFigures], stale: Sequence[StaleShare]
) -> Iterator[LivedPicture]:
    """Yield the curves where there are several settings, then each setting's bars."""
    settings = list(dict.fromkeys(one.setting for one in figures))
    if len(settings) > 1:
        yield curves_picture("Over settings", figures, stale)
    for setting in settings:
        yield LivedPicture(
            title=f"Served rightly, by kind: {setting}",
            caption="Whiskers: 95 % intervals over homes. Reliability: what rows that give a "
            "chance said of “it is still there”, in tenths with ten or more, against what was so.",
            figure=_success([one for one in figures if one.setting == setting]),
        )


def curves_picture(
    title: str, figures: Sequence[LivedFigures], stale: Sequence[StaleShare]
) -> LivedPicture:
    """Return the hard kinds and stale actions over settings, or over what stands as such."""
    return LivedPicture(
        title=title,
        caption="Shares with their 95 % intervals over homes; stale actions: of the world "
        "actions for requests, those spent on a belief that was false.",
        figure=_curves(figures, stale, list(dict.fromkeys(one.setting for one in figures))),
    )


def _success(figures: Sequence[LivedFigures]) -> Any:
    figure = empty(15, 5)
    left, right = figure.subplots(1, 2, width_ratios=(4, 1))
    _bars(left, figures)
    _reliability(right, [one for one in figures if not one.brier_assumed and one.reliability])
    return figure


def _curves(
    figures: Sequence[LivedFigures], stale: Sequence[StaleShare], settings: Sequence[str]
) -> Any:
    figure = empty(16, 4.6)
    axes = figure.subplots(1, len(HARD) + 1)
    for axis, kind in zip(axes, HARD, strict=False):
        points = [
            (one.row, one.setting, found.right, found.low, found.high)
            for one in figures
            for found in one.kinds
            if found.kind == kind and found.right is not None
        ]
        _curve(axis, points, settings, kind)
        axis.set_ylim(0, 1.02)
    axes[0].set_ylabel("served rightly")
    points = [(o.row, o.setting, o.share, o.low, o.high) for o in stale if o.share is not None]
    _curve(axes[-1], points, settings, STALE)
    axes[-1].set_ylim(bottom=0)
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=8, ncols=6,
                  loc="outside lower center")  # fmt: skip
    return figure


def _bars(axis: Any, figures: Sequence[LivedFigures]) -> None:
    """Draw success by kind, a bar for each row, with intervals over homes."""
    step = WIDTH / len(figures)
    for number, one in enumerate(figures):
        for place, kind in enumerate(one.kinds):
            if kind.right is None:
                continue
            x = place - WIDTH / 2 + (number + 0.5) * step
            axis.bar(x, kind.right, step * 0.95, color=_colour(number, len(figures)),
                     label=one.row if kind.kind == ALL else None)  # fmt: skip
            if kind.low is not None and kind.high is not None:
                axis.plot([x, x], [kind.low, kind.high], color="black", linewidth=0.8)
    axis.set_xticks(range(len(KINDS)), KINDS)
    axis.set_ylim(0, 1.02)
    axis.set_ylabel("served rightly")
    axis.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.07))


def _reliability(axis: Any, figures: Sequence[LivedFigures]) -> None:
    """Draw what was said of "it is still there" against what was so; the numbers are of ours."""
    axis.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
    for one in figures:
        tenths = [tenth for tenth in one.reliability if tenth[2] >= LEAST]
        if not tenths:
            continue
        said, so, number = zip(*tenths, strict=True)
        axis.plot(said, so, marker="o", markersize=4, label=one.row)
        for x, y, many in zip(said, so, number, strict=True) if one.row == OURS else ():
            axis.annotate(str(many), (x, y), fontsize=7, xytext=(3, -9),
                          textcoords="offset points")  # fmt: skip
    axis.set_xlabel("chance that was given")
    axis.set_ylabel("share that was still there")
    axis.set_xlim(0, 1.02)
    axis.set_ylim(0, 1.02)
    axis.set_title("reliability, with numbers", fontsize=9)
    if len(axis.lines) > 1:
        axis.legend(fontsize=7, loc="lower right")


def _curve(
    axis: Any, points: Sequence[tuple[str, str, float, float | None, float | None]],
    settings: Sequence[str], title: str,
) -> None:  # fmt: skip
    """Draw one share over the settings, a line for each row."""
    rows = list(dict.fromkeys(point[0] for point in points))
    for number, row in enumerate(rows):
        mine = [point for point in points if point[0] == row]
        beside = 0.3 * ((number + 0.5) / len(rows) - 0.5)  # so that whiskers can be told apart
        xs = [settings.index(point[1]) + beside for point in mine]
        colour = _colour(number, len(rows))
        axis.plot(xs, [point[2] for point in mine], marker="o", markersize=4, label=row,
                  color=colour)  # fmt: skip
        for x, (_, _, _, low, high) in zip(xs, mine, strict=True):
            if low is not None and high is not None:
                axis.plot([x, x], [low, high], color=colour, linewidth=1.0, alpha=0.6)
    axis.set_xticks(range(len(settings)), settings, fontsize=8)
    axis.set_xlim(-0.3, len(settings) - 0.7)
    axis.set_title(title, fontsize=9)


def _colour(number: int, rows: int) -> Any:
    import matplotlib as mpl

    return mpl.colormaps["tab10" if rows <= 10 else "tab20"](number % 20)


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
