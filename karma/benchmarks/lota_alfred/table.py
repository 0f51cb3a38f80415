"""Success rates of LoTa-Bench's ALFRED: of all tasks drawn, and by type."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from karma.bench.sheet import Sheet
from karma.bench.statistics import wilson
from karma.benchmarks.lota_alfred.play import LotaRecord
from karma.journal.formats import UNKNOWN
from karma.world.alfred.trial import TYPES_OF_TASK

_ALL = "all"
_SHORT = {
    "pick_and_place_simple": "simple",
    "look_at_obj_in_light": "look",
    "pick_clean_then_place_in_recep": "clean",
    "pick_heat_then_place_in_recep": "heat",
    "pick_cool_then_place_in_recep": "cool",
    "pick_and_place_with_movable_recep": "movable",
}
_CAPTION = (
    "Success at the end, %. Crashed episodes count as failed; the source leaves them out. No scores"
    " of ALFRED stand in LoTa-Bench's repository. Rooms, prompt words and examples are ours: see"
    " docs/alfred-benchmarks.md."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaFigures:
    """What a row's episodes of one type of task, or of all, come to; means are over episodes."""

    row: str
    kind: str  # "all", or a type of task
    episodes: int
    successes: int
    success: float
    low: float  # of a 95 % interval, by Wilson
    high: float
    crashed: int  # episodes that something outside ended; they count as failed
    success_without_crashed: float | None  # as the source counts
    steps: float
    failed: float  # skills, unknown ones too
    unknown: float  # skills that there are not
    calls: float
    prompt_tokens: float | None  # per call
    run_tokens: float | None  # of skills, per call


def results_of(records: Sequence[LotaRecord]) -> list[LotaFigures]:
    """Return the figures of each row: of all tasks, then by type."""
    found = []
    for row in dict.fromkeys(record.row for record in records):
        mine = [record for record in records if record.row == row]
        found.append(_figures(row, _ALL, mine))
        for kind in kinds_in(mine):
            found.append(_figures(row, kind, [one for one in mine if one.kind == kind]))
    return found


def kinds_in(records: Sequence[LotaRecord]) -> list[str]:
    """Return the types of task that there are, ALFRED's in its order first."""
    there = {record.kind for record in records}
    return [one for one in TYPES_OF_TASK if one in there] + sorted(there - {*TYPES_OF_TASK})


def _figures(row: str, kind: str, records: Sequence[LotaRecord]) -> LotaFigures:
    number, successes = len(records), sum(record.success for record in records)
    interval = wilson(successes, number)
    whole = sum(not record.error for record in records)
    answers = [answer for record in records for answer in record.answers]

    def mean(value: Callable[[LotaRecord], float]) -> float:
        return sum(map(value, records)) / number

    return LotaFigures(
        row=row,
        kind=kind,
        episodes=number,
        successes=successes,
        success=successes / number,
        low=interval.low if interval else 0.0,
        high=interval.high if interval else 1.0,
        crashed=number - whole,
        success_without_crashed=successes / whole if whole else None,
        steps=mean(lambda record: len(record.steps)),
        failed=mean(lambda record: record.failed),
        unknown=mean(lambda record: record.unknown),
        calls=mean(lambda record: record.calls),
        prompt_tokens=_known_mean([answer.prompt_tokens for answer in answers]),
        run_tokens=_known_mean([answer.run_tokens for answer in answers]),
    )


def _known_mean(values: Sequence[int | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def success_sheet(results: Sequence[LotaFigures]) -> Sheet:
    """Return success rates: of all tasks, then by type."""
    kinds = list(dict.fromkeys(one.kind for one in results))
    found = {(one.row, one.kind): one for one in results}
    lines = []
    for row in dict.fromkeys(one.row for one in results):
        rates = (_percent(found.get((row, kind))) for kind in kinds)
        lines.append((f"**{row}**", *rates))
    number = max((one.episodes for one in results if one.kind == _ALL), default=0)
    return Sheet(
        title=f"LoTa-Bench's ALFRED, {number} tasks",
        caption=_CAPTION,
        head=("row", *(_SHORT.get(kind, kind) for kind in kinds)),
        lines=tuple(lines),
    )


def detail_sheet(results: Sequence[LotaFigures]) -> Sheet:
    """Return what lies behind the rate of each row."""
    whole = [one for one in results if one.kind == _ALL]
    return Sheet(
        title="Behind the rates",
        caption="",
        head=("row", "success", "95 %", "crashed", "without them", "steps", "failed", "unknown",
              "calls", "prompt tokens", "skill tokens run"),
        lines=tuple(
            (
                one.row,
                f"{one.successes}/{one.episodes}",
                f"{100 * one.low:.1f} to {100 * one.high:.1f}",
                str(one.crashed),
                _cell(one.success_without_crashed, 100),
                f"{one.steps:.1f}",
                f"{one.failed:.1f}",
                f"{one.unknown:.1f}",
                f"{one.calls:.1f}",
                _cell(one.prompt_tokens),
                _cell(one.run_tokens),
            )
            for one in whole
        ),
    )  # fmt: skip


def _percent(one: LotaFigures | None) -> str:
    return UNKNOWN if one is None else f"{100 * one.success:.1f}"


def _cell(value: float | None, times: int = 1) -> str:
    return UNKNOWN if value is None else f"{times * value:.1f}"
