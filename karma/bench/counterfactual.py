"""What memory saves: each episode beside its twin, the same task, seed and planner without memory.

Where an episode begins depends on task and seed alone (`karma.bench.days`), so a pair differs in
the row and in nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from karma.bench.metrics import (
    ACTIONS,
    ACTIONS_RELATED,
    EXPLORATIONS,
    EXPLORATIONS_RELATED,
    SECONDS,
    Episode,
    Metric,
    episodes_of,
)
from karma.bench.records import KINDS, EpisodeRecord, EpisodeTiming, Key
from karma.bench.statistics import Estimate, bootstrap

OFF_ROW = "memory off"  # name of the twin in the experiments of eval/paper
LOTA_ROW = "LoTa-Bench (modified)"  # what the paper's figures seem to be measured against
Pair = tuple[Episode, Episode]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """What a row saves of a reference row's exploration (RE) and time (RT)."""

    row: str
    reference: str
    kind: str  # or "all"
    pairs: int
    explorations: Estimate  # RE: share of the places searched, over all pairs
    actions: Estimate  # RT: share of the world's actions
    seconds: Estimate  # the same by the clock
    explorations_related: Estimate  # the same in sub-tasks that come back to something: only
    actions_related: Estimate  # there has short-term memory anything to save
    solved_pairs: int  # pairs that both solved: who gives up early searches little
    explorations_solved: Estimate
    actions_solved: Estimate


def paired(first: Sequence[Episode], second: Sequence[Episode]) -> list[Pair]:
    """Return the episodes that both have, by task and seed, in order."""
    other = {(one.record.task, one.record.seed): one for one in second}
    mine = {(one.record.task, one.record.seed): one for one in first}
    return [(mine[key], other[key]) for key in sorted(mine) if key in other]


def both_solved(pairs: Sequence[Pair]) -> list[Pair]:
    """Return the pairs in which both rows solved the task."""
    return [(a, b) for a, b in pairs if a.record.success and b.record.success]


def reduced(metric: Metric, pairs: Sequence[Pair]) -> Estimate:
    """Return the share of an amount that the first of each pair saves of the second's.

    Sums are compared, so that a pair counts as much as there was to save; below 0 the first took
    more. None when there was nothing to save, or the amount is not known of a pair.
    """
    sums: dict[str, list[float]] = {}
    for pair in pairs:
        amounts = [metric.of(one) for one in pair]
        if any(not amount for amount in amounts):
            return Estimate(value=None)
        mine = sums.setdefault(pair[0].record.task, [0.0, 0.0])
        for place, amount in enumerate(amounts):
            mine[place] += sum(amount)
    table = np.array([sums[task] for task in sorted(sums)]).reshape(-1, 2)
    return bootstrap(table, lambda s: 1 - s[:, 0] / s[:, 1], number=len(pairs)).estimate


def reductions(
    records: Sequence[EpisodeRecord],
    timings: Mapping[Key, EpisodeTiming] | None = None,
    *,
    reference: str = OFF_ROW,
) -> tuple[Reduction, ...]:
    """Return what every row saves of a reference row's, by kind and over all; () without that row.

    The reference itself is left out.
    """
    episodes = episodes_of(records, timings)
    twins = [one for one in episodes if one.record.row == reference]
    lines = []
    for row in dict.fromkeys(record.row for record in records) if twins else ():
        mine = [one for one in episodes if one.record.row == row]
        for kind in (*KINDS, "all"):
            some = [one for one in mine if kind in (one.record.kind, "all")]
            if row != reference and (pairs := paired(some, twins)):
                lines.append(_reduction(row, reference, kind, pairs))
    return tuple(lines)


def _reduction(row: str, reference: str, kind: str, pairs: Sequence[Pair]) -> Reduction:
    solved = both_solved(pairs)
    return Reduction(
        row=row,
        reference=reference,
        kind=kind,
        pairs=len(pairs),
        explorations=reduced(EXPLORATIONS, pairs),
        actions=reduced(ACTIONS, pairs),
        seconds=reduced(SECONDS, pairs),
        explorations_related=reduced(EXPLORATIONS_RELATED, pairs),
        actions_related=reduced(ACTIONS_RELATED, pairs),
        solved_pairs=len(solved),
        explorations_solved=reduced(EXPLORATIONS, solved),
        actions_solved=reduced(ACTIONS, solved),
    )
