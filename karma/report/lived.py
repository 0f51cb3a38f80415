"""A run of lived-in homes as one page: figures, what was asked for, and days lived again."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.bench.experiment import filled
from karma.bench.folder import read_lines
from karma.bench.run_folder import EPISODES, HEADER
from karma.bench.sheet import Sheet
from karma.benchmarks.header import read_header
from karma.benchmarks.lived.experiment import LivedExperiment
from karma.benchmarks.lived.records import LivedRecord, ServedRequest
from karma.benchmarks.lived.table import OURS
from karma.benchmarks.lived.trace import DayTrace, TracedRequest, trace_day
from karma.benchmarks.run import read_results
from karma.contracts import HomeAnswer, Sighting
from karma.errors import KarmaError
from karma.files import read_json
from karma.household.ids import type_of
from karma.infer.hosted.session import Session
from karma.report.choice import choose, episode_key
from karma.report.html import data_uri, fill, script_data
from karma.report.lived_plots import as_svg, lived_picture
from karma.report.room import RoomPlan, plan_of
from karma.tasks.lived import Reader
from karma.tasks.lived.clock import DAYS
from karma.world.core.scene import Scene

BENCHMARK = "lived"
MOST_WRONG = 200  # requests that are listed
DAY_S = 86_400.0


class _Benchmarked(msgspec.Struct, frozen=True):
    benchmark: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class HomePlan:
    """A home from above, centimetres."""

    plan: RoomPlan
    walls: tuple[tuple[float, float, float, float], ...]  # x, y, width, height
    floors: tuple[str, ...]  # of rooms, as points of a polygon
    names: tuple[tuple[str, float, float], ...]  # of rooms, with their middles


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongRequest:
    """A request that the first row served wrongly."""

    task: str
    when: str
    kind: str
    text: str
    unknown: bool


def is_lived(run: Path) -> bool:
    """Return whether a folder holds a run of lived-in homes."""
    if not (run / HEADER).exists():
        return False
    return read_json(run / HEADER, _Benchmarked).benchmark == BENCHMARK


def lived_page(run: Path, wanted: str) -> Iterator[float | str]:
    """Live the chosen days again; yield what part of them is done, and last the page.

    Args:
        run: its folder, finished or not.
        wanted: which days: "" for the first that the first row did not get all right, or as
            `choose` takes it, such as "ours/usual/home_003/day_2/0".

    Raises:
        FileError: the folder is damaged.
        KarmaError: there is no such day, or another comes out than was recorded.
    """
    header = read_header(run)
    experiment = msgspec.convert(header.experiment, LivedExperiment)
    records = read_lines(run / EPISODES, LivedRecord)
    if not records:
        raise KarmaError(f"{run}: no day is over yet\n  To fix: karma eval FILE --out {run}")
    results = read_results(run)
    chosen = choose(records, wanted) if wanted else [_first_wrong(records)]
    days = []
    for number, record in enumerate(chosen):
        yield number / len(chosen)
        days.append(_lived_again(experiment, records, record))
    homes = {day.scene.name: _home_plan(day.scene) for day in days}
    sheets: tuple[Sheet, ...] = (results.table, *results.behind)
    yield fill(
        "lived.html.j2",
        script="lived.js.j2",
        title=header.name,
        remarks=results.remarks,
        picture=data_uri("image/svg+xml", as_svg(lived_picture(results.figures))),
        sheets=sheets,
        days=[(number, day, _others(records, day.record)) for number, day in enumerate(days)],
        homes=homes,
        wrong=list(_wrong(records))[:MOST_WRONG],
        wrong_row=records[0].row,
        clock=clock_words,
        key=episode_key,
        data=script_data([_told(day) for day in days]),
    )


def clock_words(time_s: float) -> str:
    """Return a time as people read it.

    >>> clock_words(86_400 + 9 * 3600 + 61)
    'Tue 09:01'
    """
    day, second = divmod(time_s, DAY_S)
    minute = int(second // 60)
    return f"{DAYS[int(day) % 7][:3]} {minute // 60:02d}:{minute % 60:02d}"


def answer_words(answer: HomeAnswer) -> str:
    """Return an answer in words.

    >>> answer_words(HomeAnswer(count=3)), answer_words(HomeAnswer(unknown=True))
    ('3', 'I do not know')
    """
    if answer.unknown:
        return "I do not know"
    if answer.count is not None:
        return str(answer.count)
    if answer.time_s is not None:
        return clock_words(answer.time_s)
    return answer.who or ", ".join(one for one in (answer.place_type, answer.room) if one)


# ----------------------------------------------------------------- parts


def _first_wrong(records: Sequence[LivedRecord]) -> LivedRecord:
    """Return the first day that ours, else the first row, did not get all right; else the first."""
    rows = {record.row for record in records}
    row = OURS if OURS in rows else records[0].row
    mine = [record for record in records if record.row == row]
    return next((record for record in mine if not record.success), mine[0])


def _wrong(records: Sequence[LivedRecord]) -> Iterator[WrongRequest]:
    """Yield what the first row served wrongly, in the order of the run."""
    for record in records:
        for one in record.requests if record.row == records[0].row else ():
            if not one.right:
                yield WrongRequest(
                    task=episode_key(record), when=clock_words(one.time_s), kind=one.kind,
                    text=one.text, unknown=one.unknown,
                )  # fmt: skip


def _lived_again(
    experiment: LivedExperiment, records: Sequence[LivedRecord], record: LivedRecord
) -> DayTrace:
    """Return a day of the run, lived again."""
    embedder = filled("embedders", experiment.models.embedder, None, Session(), experiment.models)
    home = record.task.rpartition("/")[0]
    return trace_day(
        experiment,
        next(row for row in experiment.rows if row.name == record.row),
        next(spec for spec in experiment.specs() if spec.name == home),
        record.seed,
        record.day,
        embedder,
        Reader(embedder),
        expected=[
            one
            for one in records
            if (one.row, one.task.rpartition("/")[0], one.seed) == (record.row, home, record.seed)
        ],
    )


def _others(
    records: Sequence[LivedRecord], record: LivedRecord
) -> list[tuple[str, dict[float, ServedRequest]]]:
    """Return what every row made of a day's requests, by the time that they were made at."""
    return [
        (one.row, {request.time_s: request for request in one.requests})
        for one in records
        if (one.task, one.seed) == (record.task, record.seed)
    ]


def _home_plan(scene: Scene) -> HomePlan:
    rooms, walls = scene.rooms or (), scene.walls or ()
    return HomePlan(
        plan=plan_of(scene, None),
        walls=tuple(
            (
                _cm(wall.low[0]), _cm(-wall.high[2]), _cm(wall.high[0] - wall.low[0]),
                _cm(wall.high[2] - wall.low[2]),
            )
            for wall in walls
        ),
        floors=tuple(
            " ".join(f"{_cm(x):g},{_cm(-z):g}" for x, z in room.corners) for room in rooms
        ),
        names=tuple(
            (
                room.name.replace("_", " "),
                _cm(sum(x for x, _ in room.corners) / len(room.corners)),
                _cm(-sum(z for _, z in room.corners) / len(room.corners)),
            )
            for room in rooms
        ),
    )  # fmt: skip


def _told(day: DayTrace) -> dict[str, Any]:
    """Return a day as the script reads it; metres as centimetres, z up the page."""
    at = {name: (x, y) for name, x, y in _home_plan(day.scene).names}
    return {
        "home": day.scene.name,
        "begin": DAY_S * day.record.day,
        "people": [
            [name, *at.get(room.replace("_", " "), (0.0, 0.0))] for name, room in day.people
        ],
        "things": [[one.object_id, *_xy(one)] for one in day.things],
        "steps": [
            [round(one.time_s, 1), _cm(one.x_m), _cm(-one.z_m), one.yaw_deg, one.held]
            for one in day.steps
        ],
        "deeds": [
            [round(one.time_s, 1), one.who, one.action, one.object_id, one.place_id or "",
             _cm(one.x_m), _cm(-one.z_m)]
            for one in day.deeds
        ],
        "requests": [_told_request(one) for one in day.requests],
    }  # fmt: skip


def _told_request(one: TracedRequest) -> dict[str, Any]:
    return {
        "begin": one.begin_s,
        "end": one.end_s,
        "speaker": one.speaker,
        "text": one.served.text,
        "kind": one.served.kind,
        "right": one.served.right,
        "actions": one.served.actions,
        "answer": "" if one.served.asked == "errand" else answer_words(one.answer),
        "gave_up": one.served.asked == "errand" and one.answer.unknown,
        "of_thing": one.served.knew is not None,
        "believed": None if one.believed is None else [_there(one.believed), *_xy(one.believed)],
        "truth": [[_there(thing), *_xy(thing)] for thing in one.truth],
    }


def _there(seen: Sighting) -> str:
    """Return a thing and where it lies, in words."""
    place = type_of(seen.place_id) if seen.place_id else "the floor"
    return f"{type_of(seen.object_id)}: {', '.join(one for one in (place, seen.room) if one)}"


def _xy(seen: Sighting) -> tuple[float, float]:
    return _cm(seen.position_m[0]), _cm(-seen.position_m[2])


def _cm(metres: float) -> float:
    return round(metres * 100, 1) + 0.0
