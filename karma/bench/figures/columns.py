"""The figures of a run: every metric and every saving of every row and kind of task.

The terminal, `results.json`, the tables, the report and comparisons all take theirs from here. What
memory saves is told by each episode beside its twin, the same task, seed and planner without
memory: where an episode begins depends on task and seed alone (`karma.bench.engine.episode`), so a
pair differs in the row and in nothing else.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from karma.bench.figures.metrics import (
    METRICS,
    Amount,
    Metric,
    Observations,
    TimedEpisode,
    actions,
    actions_related,
    episodes_of,
    explorations,
    explorations_related,
    measure,
    seconds,
)
from karma.bench.figures.statistics import Estimate, Floats, bootstrap
from karma.files import to_json
from karma.journal.records import (
    ALL,
    NOT_TRAINED,
    TRAINED,
    EpisodeRecord,
    EpisodeTiming,
    Key,
    is_of,
    kinds_of,
)
from karma.types.memory import Tour

OFF_ROW = "memory off"  # name of the twin in the experiments of eval/paper
Pair = tuple[TimedEpisode, TimedEpisode]


def with_tour(amount: Amount, cost: Callable[[Tour], int]) -> Amount:
    """Return an amount with the first tour of each room, spread over all instructions in it."""

    def of(episode: TimedEpisode) -> Observations:
        here = Counter(episode.record.rooms)
        tours = sum(
            cost(tour) * here[room] / asked
            for room, (tour, asked) in episode.tours.items()
            if here[room]
        )
        return [one + tours for one in amount(episode)]

    return of


# `of` is the amount that a method saves; undefined where it is not known of an episode
SAVINGS = (
    Metric("re", "RE", explorations),
    Metric("rt", "RT", actions),
    Metric("rt_clock", "RT (clock)", seconds),
    Metric("re_related", "RE related", explorations_related),
    Metric("rt_related", "RT related", actions_related),
    Metric("re_solved", "RE both solved", explorations, both_solved=True),
    Metric("rt_solved", "RT both solved", actions, both_solved=True),
    Metric("re_toured", "RE with tour", with_tour(explorations, lambda tour: tour.places)),
    Metric("rt_toured", "RT with tour", with_tour(actions, lambda tour: tour.actions)),
)


def paired(first: Sequence[TimedEpisode], second: Sequence[TimedEpisode]) -> list[Pair]:
    """Return the episodes that both have, by task and seed, in order."""
    other = {(episode.record.task, episode.record.seed): episode for episode in second}
    mine = {(one.record.task, one.record.seed): one for one in first}
    return [(mine[key], other[key]) for key in sorted(mine) if key in other]


def reduced(amount: Amount, pairs: Sequence[Pair]) -> Estimate:
    """Return the share of an amount that the first of each pair saves of the second's.

    Sums are compared, so that a pair counts as much as there was to save; below 0 the first took
    more. None when there was nothing to save, or the amount is not known of a pair.
    """
    if any(not amount(one) for pair in pairs for one in pair):
        return Estimate(value=None)
    table = paired_sums(pairs, lambda one: [sum(amount(one))])
    return bootstrap(table, lambda s: 1 - s[:, 0] / s[:, 1], number=len(pairs))


def paired_sums(pairs: Sequence[Pair], of: Amount) -> Floats:
    """Return the sums of the observations over each task's pairs, in order of tasks.

    Shape (tasks, columns), where the columns of the first stand before those of the second.
    """
    sums: dict[str, Floats] = {}
    for first, second in pairs:
        seen = np.array([*of(first), *of(second)], dtype=float)
        sums[first.record.task] = sums.get(first.record.task, 0.0) + seen
    return np.array([sums[task] for task in sorted(sums)])


def by_row_and_kind(
    episodes: Sequence[TimedEpisode], kinds: Iterable[str]
) -> Iterator[tuple[str, str, list[TimedEpisode]]]:
    """Yield the episodes of every row, in the order of rows, and of each of the kinds it has."""
    kinds = tuple(kinds)
    for row in dict.fromkeys(episode.record.row for episode in episodes):
        mine = [one for one in episodes if one.record.row == row]
        for kind in kinds:
            if some := [one for one in mine if is_of(one.record, kind)]:
                yield row, kind, some


COLUMNS = {one.key: one for one in (*METRICS, *SAVINGS)}  # of `Figures.values`


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """All figures of a row on a kind of task."""

    row: str
    kind: str  # or one of "all", "in training", "not in training"
    episodes: int
    tasks: int
    seeds: int
    pairs: int  # with the same task and seed without memory
    solved_pairs: int  # that both solved
    values: Mapping[str, Estimate]  # by the keys of `COLUMNS`
    unjudged: Mapping[str, str] = field(default_factory=dict)  # tasks left out of it, and why

    @property
    def successes(self) -> int:
        """How many episodes solved their task."""
        return round((self.values["success"].value or 0.0) * self.episodes)


def figures(
    records: Sequence[EpisodeRecord], timings: Mapping[Key, EpisodeTiming] | None = None
) -> tuple[Figures, ...]:
    """Return all figures by row and kind, in all, and split by presence in training data.

    Methods stand in the order of the records, kinds in the paper's. Savings are undefined in a run
    without `OFF_ROW`, seconds without timings.
    """
    return figures_of(records, episodes_of(records, timings))


def figures_of(
    records: Sequence[EpisodeRecord], episodes: Sequence[TimedEpisode]
) -> tuple[Figures, ...]:
    """Return the figures of episodes, see `figures`."""
    twins = [episode for episode in episodes if episode.record.row == OFF_ROW]
    kinds = (*kinds_of(episode.record for episode in episodes), ALL, TRAINED, NOT_TRAINED)
    lines = []
    for row, kind, some in by_row_and_kind(episodes, kinds):
        pairs = paired(some, twins) if row != OFF_ROW else []
        solved = [(a, b) for a, b in pairs if a.record.success and b.record.success]
        lines.append(
            Figures(
                row=row,
                kind=kind,
                episodes=len(some),
                tasks=len({one.record.task for one in some}),
                seeds=len({one.record.seed for one in some}),
                pairs=len(pairs),
                solved_pairs=len(solved),
                values={metric.key: measure(metric, some) for metric in METRICS}
                | {
                    saving.key: reduced(saving.of, solved if saving.both_solved else pairs)
                    for saving in SAVINGS
                },
                unjudged={
                    record.task: record.unjudged
                    for record in records
                    if record.row == row and is_of(record, kind) and record.unjudged
                },
            )
        )
    return tuple(lines)


def without_repeats(lines: Sequence[Figures]) -> list[Figures]:
    """Return lines without the totals if there is a single kind."""
    alone = len({line.kind for line in lines} - {ALL, TRAINED, NOT_TRAINED}) == 1
    return [line for line in lines if not (alone and line.kind == ALL)]


def plain(lines: Sequence[Figures]) -> list[dict[str, Any]]:
    """Return figures as JSON has them: null where not measured, nothing that no line has measured.

    A figure is its value, the ends of its interval if it has one, and the number of observations.
    """
    measured = [key for key in COLUMNS if any(one.values[key].value is not None for one in lines)]
    return [
        {
            "row": line.row,
            "kind": line.kind,
            "episodes": line.episodes,
            "tasks": line.tasks,
            "seeds": line.seeds,
            "values": {key: _estimate_data(line.values[key]) for key in measured},
            **({"unjudged": dict(line.unjudged)} if line.unjudged else {}),
        }
        for line in lines
    ]


def added_up(records: Sequence[EpisodeRecord]) -> bytes:
    """Return the figures of a run as `results.json` holds them."""
    return to_json(plain(figures(records)), indent=2)


def _estimate_data(found: Estimate) -> dict[str, float | None] | None:
    if found.value is None:
        return None
    ends = found.interval
    return {
        "value": found.value,
        "low": ends.low if ends else None,
        "high": ends.high if ends else None,
        "number": found.number,
    }
