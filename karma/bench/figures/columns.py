"""The figures of a run: every metric and every saving of every row and kind of task.

The terminal, `results.json`, the tables, the report and comparisons all take theirs from here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from karma.agent.journal.records import (
    ALL,
    NOT_TRAINED,
    TRAINED,
    EpisodeRecord,
    EpisodeTiming,
    Key,
    is_of,
    kinds_of,
)
from karma.bench.figures.counterfactual import SAVINGS, Reduction, Saving, reductions
from karma.bench.figures.metrics import (
    METRICS,
    Metric,
    TimedEpisode,
    episodes_of,
    measure,
    unjudged,
)
from karma.bench.figures.statistics import Estimate
from karma.files import to_json

Counted = TypeVar("Counted", "Figures", Reduction)
_LISTED: tuple[Metric | Saving, ...] = (*METRICS, *SAVINGS)
COLUMNS = {one.key: one for one in _LISTED}  # of `Figures.values`


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """All figures of one row and kind of task."""

    row: str
    kind: str  # or one of "all", "in training", "not in training"
    episodes: int
    tasks: int
    seeds: int
    values: Mapping[str, Estimate]  # by the keys of `COLUMNS`
    unjudged: Mapping[str, str] = field(default_factory=dict)  # tasks left out of it, and why

    @property
    def successes(self) -> int:
        """How many episodes solved their task."""
        return round((self.values["success"].value or 0.0) * self.episodes)


def figures(
    records: Sequence[EpisodeRecord], timings: Mapping[Key, EpisodeTiming] | None = None
) -> tuple[Figures, ...]:
    """Return every figure of every row and kind, of all, and of what is in training data and not.

    Rows stand in the order of the records, kinds in the paper's. What is measured against a
    reference row is undefined in a run without it, what is measured in seconds without timings.
    """
    episodes = episodes_of(records, timings)
    return figures_of(records, episodes, reductions(episodes))


def figures_of(
    records: Sequence[EpisodeRecord],
    episodes: Sequence[TimedEpisode],
    reductions: Sequence[Reduction],
) -> tuple[Figures, ...]:
    """Return the figures of the episodes of some records with what they save, see `figures`."""
    saved = {(one.row, one.kind): one.values for one in reductions}
    lines = []
    kinds = (*kinds_of(one.record for one in episodes), ALL, TRAINED, NOT_TRAINED)
    for row in dict.fromkeys(one.record.row for one in episodes):
        mine = [one for one in episodes if one.record.row == row]
        for kind in kinds:
            if some := [one for one in mine if is_of(one.record, kind)]:
                savings = saved.get((row, kind), {})
                told = (one for one in records if one.row == row and is_of(one, kind))
                lines.append(
                    Figures(
                        row=row,
                        kind=kind,
                        episodes=len(some),
                        tasks=len({one.record.task for one in some}),
                        seeds=len({one.record.seed for one in some}),
                        values={metric.key: measure(metric, some) for metric in METRICS}
                        | {one.key: savings.get(one.key, Estimate(value=None)) for one in SAVINGS},
                        unjudged=unjudged(told),
                    )
                )
    return tuple(lines)


def without_repeats(lines: Sequence[Counted]) -> list[Counted]:
    """Return lines without those over all kinds where there is only one kind."""
    alone = len({line.kind for line in lines} - {ALL, TRAINED, NOT_TRAINED}) == 1
    return [line for line in lines if not (alone and line.kind == ALL)]


def plain(lines: Sequence[Figures]) -> list[dict[str, Any]]:
    """Return figures as JSON has them: null where not measured, nothing that no line has measured.

    A figure is its value, the ends of its interval if it has one, and the number of observations.
    """
    measured = [key for key in COLUMNS if any(one.values[key].value is not None for one in lines)]
    return [
        {
            "row": one.row,
            "kind": one.kind,
            "episodes": one.episodes,
            "tasks": one.tasks,
            "seeds": one.seeds,
            "values": {key: _plain(one.values[key]) for key in measured},
            **({"unjudged": dict(one.unjudged)} if one.unjudged else {}),
        }
        for one in lines
    ]


def added_up(records: Sequence[EpisodeRecord]) -> bytes:
    """Return the figures of a run as `results.json` holds them."""
    return to_json(plain(figures(records)), indent=2)


def _plain(found: Estimate) -> dict[str, float | None] | None:
    if found.value is None:
        return None
    ends = found.interval
    return {
        "value": found.value,
        "low": ends.low if ends else None,
        "high": ends.high if ends else None,
        "number": found.number,
    }
