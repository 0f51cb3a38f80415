"""A run of lived-in homes as one page: figures, requests, and a day lived again on the map."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from karma.agent.journal.header import BenchmarkHeader
from karma.bench.engine.benchmark_runs import read_played
from karma.bench.figures.sheet import Sheet
from karma.bench.report.html import fill, script_data
from karma.bench.report.lived_day import WALK_S, day_name, told_day
from karma.bench.report.lived_pictures import curves_picture, lived_pictures
from karma.bench.report.page import columns_of, facts_of
from karma.bench.report.room import plan_of
from karma.bench.suites.lived.benchmark import LivedHomes
from karma.bench.suites.lived.records import LivedRecord
from karma.bench.suites.lived.request import DAY_S
from karma.bench.suites.lived.table import OURS, by_day, figures_of, stale_shares
from karma.bench.suites.lived.trace import HomeTrace
from karma.errors import KarmaError, did_you_mean

NAMED = 6  # homes in a message
DRAWN_CM = 800.0  # of a home, at which marks have their usual size


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedRun:
    """A run of lived-in homes as it was read."""

    folder: Path
    header: BenchmarkHeader
    benchmark: LivedHomes
    records: tuple[LivedRecord, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedDay:
    """The day that the page replays."""

    record: LivedRecord
    trace: HomeTrace


def read_lived(folder: Path) -> LivedRun:
    """Read a run, finished or not.

    Raises:
        KarmaError: it is torn, or no day is done.
    """
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

    Args:
        run: the run.
        home: such as "usual/home_003"; "" any.
        day: from 0; None: any.
        row: "" is ours, or the first.

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
    """Live a home again up to a day.

    Args:
        run: it was played in.
        record: of the day.
        after_day: called when a day is over.

    Raises:
        KarmaError: what comes out is not what the run says.
    """
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
            raise KarmaError(
                f"{run.folder}: {one.task} of {one.row!r}, lived again, is not as the run says: "
                f"{', '.join(names)} differ; it was made by {_versions(run)}, or its files have "
                f"changed since\n  To fix: karma eval FILE --out {run.folder} --fresh"
            )
    return LivedDay(record=record, trace=trace)


def _versions(run: LivedRun) -> str:
    return ", ".join(f"{name} {version}" for name, version in run.header.versions.items())


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
