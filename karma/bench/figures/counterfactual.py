"""What memory saves: each episode beside its twin, the same task, seed and planner without memory.

Where an episode begins depends on task and seed alone (`karma.bench.tasks.days`), so a pair
differs in the row and in nothing else.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from karma.agent.journal.records import ALL, is_of, kinds_of
from karma.bench.figures.metrics import (
    Amount,
    Observations,
    TimedEpisode,
    actions,
    actions_related,
    explorations,
    explorations_related,
    seconds,
)
from karma.bench.figures.statistics import Estimate, Floats, bootstrap
from karma.contracts import Tour

OFF_ROW = "memory off"  # name of the twin in the experiments of eval/paper
LOTA_ROW = "LoTa-Bench (modified)"  # what the paper's figures seem to be measured against
SPREADS = (10, 40)  # instructions in a room that its first tour is spread over
Pair = tuple[TimedEpisode, TimedEpisode]


@dataclass(frozen=True, slots=True, kw_only=True)
class Saving:
    """One way to say what a row saves of an amount.

    Args:
        key: its name in files.
        title: its name in tables.
        says: what it is, in few words.
        amount: of an episode; undefined where it is not known of one.
        is_solved: only pairs that both rows solved; an agent that gives up early searches little.
        digits: after the point.
    """

    key: str
    title: str
    says: str
    amount: Amount
    is_solved: bool = False
    digits: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """What a row saves of a reference row's exploration (RE) and time (RT)."""

    row: str
    reference: str
    kind: str  # or "all"
    pairs: int
    solved_pairs: int  # that both rows solved
    values: Mapping[str, Estimate]  # by the key of each saving


def with_tour(
    amount: Amount, cost: Callable[[Tour], int], instructions: int | None = None
) -> Amount:
    """Return an amount with the first tour of each room, spread evenly over instructions in it.

    `instructions`: over so many; None: over those that the whole row was asked in the room.
    """

    def of(episode: TimedEpisode) -> Observations:
        here = Counter(episode.record.rooms)
        tours = sum(
            cost(tour) * here[room] / (instructions or asked)
            for room, (tour, asked) in episode.tours.items()
            if here[room]
        )
        return [one + tours for one in amount(episode)]

    return of


def _toured(
    letter: str, what: str, amount: Amount, cost: Callable[[Tour], int]
) -> tuple[Saving, ...]:
    """Return the savings with the tour over the row's own instructions, then over `SPREADS`."""
    name = f"r{letter.lower()}_toured"
    return (
        Saving(
            key=name, title=f"R{letter} with tour", amount=with_tour(amount, cost),
            says=f"{what} with the first tour of each room, spread over all that was asked in it",
        ),
        *(
            Saving(
                key=f"{name}_{number}", title=f"R{letter}, tour over {number}",
                amount=with_tour(amount, cost, number),
                says=f"{what} with the first tour, spread over {number} instructions in the room",
            )
            for number in SPREADS
        ),
    )  # fmt: skip


SAVINGS = (
    Saving(
        key="re", title="RE", amount=explorations,
        says="searching saved against the row without memory (reduced exploration)",
    ),
    Saving(
        key="rt", title="RT", amount=actions,
        says="steps saved against the row without memory (reduced time)",
    ),
    Saving(key="rt_clock", title="RT (clock)", amount=seconds, says="the same in seconds"),
    Saving(
        key="re_related", title="RE related", amount=explorations_related,
        says="RE in instructions that come back to a thing: only there has memory what to save",
    ),
    Saving(
        key="rt_related", title="RT related", amount=actions_related,
        says="RT in instructions that come back to a thing",
    ),
    Saving(
        key="re_solved", title="RE both solved", amount=explorations, is_solved=True,
        says="RE in the pairs that both rows solved",
    ),
    Saving(
        key="rt_solved", title="RT both solved", amount=actions, is_solved=True,
        says="RT in the pairs that both rows solved",
    ),
    *_toured("E", "RE", explorations, lambda tour: tour.places),
    *_toured("T", "RT", actions, lambda tour: tour.actions),
)  # fmt: skip


def paired(first: Sequence[TimedEpisode], second: Sequence[TimedEpisode]) -> list[Pair]:
    """Return the episodes that both have, by task and seed, in order."""
    other = {(one.record.task, one.record.seed): one for one in second}
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
    return bootstrap(table, lambda s: 1 - s[:, 0] / s[:, 1], number=len(pairs)).estimate


def paired_sums(pairs: Sequence[Pair], of: Amount) -> Floats:
    """Return the sums of what is seen in each episode over every task's pairs, in order of tasks.

    Shape (tasks, columns), where the columns of the first stand before those of the second.
    """
    sums: dict[str, Floats] = {}
    for first, second in pairs:
        seen = np.array([*of(first), *of(second)], dtype=float)
        sums[first.record.task] = sums.get(first.record.task, 0.0) + seen
    return np.array([sums[task] for task in sorted(sums)])


def reductions(
    episodes: Sequence[TimedEpisode], *, reference: str = OFF_ROW
) -> tuple[Reduction, ...]:
    """Return what every row saves of a reference row's, by kind and over all; () without that row.

    The reference itself is left out.
    """
    twins = [one for one in episodes if one.record.row == reference]
    lines = []
    for row in dict.fromkeys(one.record.row for one in episodes) if twins else ():
        mine = [one for one in episodes if one.record.row == row]
        for kind in (*kinds_of(one.record for one in episodes), ALL):
            some = [one for one in mine if is_of(one.record, kind)]
            if row == reference or not (pairs := paired(some, twins)):
                continue
            solved = [(a, b) for a, b in pairs if a.record.success and b.record.success]
            values = {
                one.key: reduced(one.amount, solved if one.is_solved else pairs) for one in SAVINGS
            }
            lines.append(
                Reduction(
                    row=row, reference=reference, kind=kind, pairs=len(pairs),
                    solved_pairs=len(solved), values=values,
                )
            )  # fmt: skip
    return tuple(lines)
