"""Compare two arms over the same tasks and seeds: differences, intervals and tests."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from karma.bench.figures.columns import Pair, paired, paired_sums
from karma.bench.figures.metrics import METRICS, SUCCESS, Metric, TimedEpisode, measure
from karma.bench.figures.statistics import (
    Estimate,
    Floats,
    Statistic,
    bootstrap,
    mcnemar,
    sign_flip,
)
from karma.errors import KarmaError
from karma.journal.records import ALL, EpisodeRecord, is_of, kinds_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Arm:
    """A side of a comparison: the episodes of a row, from `episodes_of`."""

    name: str
    episodes: Sequence[TimedEpisode]


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricPair:
    """A metric of both arms over the same pairs."""

    key: str
    title: str
    digits: int
    first: Estimate
    second: Estimate
    difference: Estimate  # first - second


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """A task solved by a single arm, with the seeds."""

    task: str
    seeds: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Two arms, paired by task and seed."""

    first: str
    second: str
    kind: str  # or "all"
    pairs: int
    tasks: int
    seeds: tuple[int, ...]
    only_first: tuple[Split, ...]
    only_second: tuple[Split, ...]
    p: float  # McNemar's exact test of the success rates, pairs taken as independent
    p_tasks: float  # the same with a task's seeds kept together
    ratio: Estimate  # of the success rates, first / second
    lines: tuple[MetricPair, ...]

    @property
    def success(self) -> MetricPair:
        """The success rates of both."""
        return next(line for line in self.lines if line.key == SUCCESS.key)


def compare(first: Arm, second: Arm, *, kind: str = ALL) -> Comparison:
    """Compare two arms over the pairs that both have.

    Raises:
        KarmaError: the arms are over different tasks, or have no pair of the kind in common.
    """
    check_same_tasks(first, second)
    pairs = [
        pair for pair in paired(first.episodes, second.episodes) if is_of(pair[0].record, kind)
    ]
    if not pairs:
        raise KarmaError(
            f"{first.name} and {second.name} have no episode of kind {kind!r} with the same task "
            f"and seed: seeds {_seeds(first)} against {_seeds(second)}\n"
            "  To fix: karma eval both with the same `seeds`"
        )
    only_first = [a for a, b in pairs if a.record.success and not b.record.success]
    only_second = [b for a, b in pairs if b.record.success and not a.record.success]
    gaps: Counter[str] = Counter(one.record.task for one in only_first)
    gaps.subtract(one.record.task for one in only_second)
    return Comparison(
        first=first.name,
        second=second.name,
        kind=kind,
        pairs=len(pairs),
        tasks=len({a.record.task for a, _ in pairs}),
        seeds=tuple(sorted({a.record.seed for a, _ in pairs})),
        only_first=_splits(only_first),
        only_second=_splits(only_second),
        p=mcnemar(len(only_first), len(only_second)),
        p_tasks=sign_flip(list(gaps.values())),
        ratio=_resampled(SUCCESS, pairs, _ratio),
        lines=tuple(_line(metric, pairs) for metric in METRICS),
    )


def compare_kinds(first: Arm, second: Arm) -> tuple[Comparison, ...]:
    """Return comparisons: over all pairs if they have several kinds, then by kind.

    Raises:
        KarmaError: as `compare` does.
    """
    kinds = list(kinds_of(a.record for a, _ in paired(first.episodes, second.episodes)))
    if len(kinds) != 1:
        kinds.insert(0, ALL)
    return tuple(compare(first, second, kind=kind) for kind in kinds)


# ----------------------------------------------------------------- the same tasks


def check_same_tasks(first: Arm, second: Arm) -> None:
    """See that two arms were asked the same.

    Raises:
        KarmaError: names the tasks that only one has, or the first that differs.
    """
    mine, other = _asked(first.episodes), _asked(second.episodes)
    only = {first.name: sorted(mine.keys() - other), second.name: sorted(other.keys() - mine)}
    words = [f"only {name} has {_some(tasks)}" for name, tasks in only.items() if tasks]
    words += [
        f"task {task} asks something else in {second.name} than in {first.name}"
        for task in sorted(mine.keys() & other)
        if not _agree(mine[task], other[task])
    ][:1]
    if words:
        raise KarmaError(
            "the runs are over different tasks, so nothing can be said about them together:\n  "
            + "\n  ".join(words)
            + "\n  To fix: karma eval both over the same `tasks` and `only`, and to their end"
        )


_TaskWords = tuple[str, str, tuple[tuple[str, tuple[str, ...]], ...]]  # scene, kind, sub-tasks


def _asked(episodes: Sequence[TimedEpisode]) -> Mapping[str, _TaskWords]:
    """Return scene, kind and sub-tasks of each task, from its longest record."""
    found: dict[str, _TaskWords] = {}
    for one in episodes:
        record = one.record
        parts = tuple((sub.instruction, sub.goals) for sub in record.subtasks)
        if record.task not in found or len(parts) > len(found[record.task][2]):
            found[record.task] = record.scene, record.kind, parts
    return found


def _agree(mine: _TaskWords, other: _TaskWords) -> bool:
    """Return whether two records have equal sub-tasks up to the end of the shorter record."""
    shorter = min(len(mine[2]), len(other[2]))
    return mine[:2] == other[:2] and mine[2][:shorter] == other[2][:shorter]


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def _seeds(arm: Arm) -> list[int]:
    return sorted({episode.record.seed for episode in arm.episodes})


# ----------------------------------------------------------------- figures


def _line(metric: Metric, pairs: Sequence[Pair]) -> MetricPair:
    first, second = (measure(metric, arm) for arm in zip(*pairs, strict=True))
    known = first.value is not None and second.value is not None
    return MetricPair(
        key=metric.key,
        title=metric.title,
        digits=metric.digits,
        first=first,
        second=second,
        difference=_resampled(metric, pairs, _difference) if known else Estimate(value=None),
    )


def _resampled(metric: Metric, pairs: Sequence[Pair], statistic: Statistic) -> Estimate:
    """Return the difference or ratio of two means over resampled tasks.

    A figure that is the same in every task has no interval: resamples cannot tell how sure it is.
    """

    def total(episode: TimedEpisode) -> tuple[float, int]:
        seen = metric.of(episode)
        return sum(seen), len(seen)

    found = bootstrap(paired_sums(pairs, total), statistic, number=len(pairs))
    ends = found.interval
    if ends is not None and math.isclose(ends.low, ends.high, abs_tol=1e-12):
        return replace(found, interval=None)
    return found


def _difference(sums: Floats) -> Floats:
    gap: Floats = sums[:, 0] / sums[:, 1] - sums[:, 2] / sums[:, 3]
    return gap


def _ratio(sums: Floats) -> Floats:
    share: Floats = (sums[:, 0] * sums[:, 3]) / (sums[:, 1] * sums[:, 2])
    return share


def _splits(episodes: Sequence[TimedEpisode]) -> tuple[Split, ...]:
    found: dict[str, list[int]] = {}
    for one in episodes:
        found.setdefault(one.record.task, []).append(one.record.seed)
    return tuple(Split(task=task, seeds=tuple(sorted(found[task]))) for task in sorted(found))


def rows_of(records: Iterable[EpisodeRecord]) -> tuple[str, ...]:
    """Return the rows in order of appearance."""
    return tuple(dict.fromkeys(record.row for record in records))


def arm_of(
    records: Sequence[EpisodeRecord], episodes: Sequence[TimedEpisode], row: str, name: str = ""
) -> Arm:
    """Return a row as an arm, named after the row unless a name is given.

    Raises:
        KarmaError: there is no such row; names those there are.
    """
    rows = rows_of(records)
    if row not in rows:
        raise KarmaError(f"no row {row!r}; there are {', '.join(map(repr, rows))}")
    return Arm(
        name=name or row, episodes=[episode for episode in episodes if episode.record.row == row]
    )
