"""Whether a run has seeds enough: how wide the intervals of its success rates still are.

Everything follows from the records of complete seeds, so a run that was killed, or done by several
workers, begins the same seeds as one that was not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from karma.agent.journal.records import ALL, EpisodeRecord, kinds_of
from karma.bench.figures.columns import Figures, by_row_and_kind
from karma.bench.figures.metrics import SUCCESS, by_task, episodes_of
from karma.bench.figures.statistics import Estimate, more_seeds, rate
from karma.errors import KarmaError, did_you_mean

MAX_SEEDS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Precision:
    """How sure every success rate is wanted to be, and what that may cost.

    Raises:
        ValueError: a half-width that no rate can have, or no seed at all.
    """

    half_width: float
    max_seeds: int = MAX_SEEDS

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        if not 0 < self.half_width < 0.5:
            raise ValueError(f"half-width {self.half_width:g}: it is between 0 and 0.5")
        if self.max_seeds < 1:
            raise ValueError(f"{self.max_seeds} seeds at most: it is 1 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """How sure the success rate of a row and kind of task is."""

    row: str
    kind: str
    tasks: int
    seeds: int
    success: Estimate
    more_seeds: int | None  # to the half-width that was wanted, as it seems; None: not known
    takes_tasks: bool  # no number of seeds will do: tasks differ too much, or are too few

    @property
    def reached(self) -> bool:
        """Whether the interval is narrow enough."""
        return self.more_seeds == 0


def reached(records: Sequence[EpisodeRecord], wanted: Precision) -> tuple[Reached, ...]:
    """Return how sure each row is of each kind of task, in the order of rows and kinds.

    The records are of complete seeds; their order changes no figure.
    """
    episodes, width = episodes_of(records), wanted.half_width
    found = []
    for row, kind, some in by_row_and_kind(episodes, kinds_of(one.record for one in episodes)):
        mine = list(by_task(SUCCESS, some).values())
        seeds = max(map(len, mine))
        hopeless = seeds > 1 and more_seeds(mine, width, at_least=True) is None
        found.append(
            Reached(
                row=row, kind=kind, tasks=len(mine), seeds=seeds, success=rate(mine),
                more_seeds=more_seeds(mine, width), takes_tasks=hopeless,
            )
        )  # fmt: skip
    return tuple(found)


def takes_another(records: Sequence[EpisodeRecord], wanted: Precision, seeds: int) -> bool:
    """Return whether one seed more than those that are done is wanted, allowed, and of use."""
    if seeds >= wanted.max_seeds:
        return False
    return any(not one.reached and not one.takes_tasks for one in reached(records, wanted))


@dataclass(frozen=True, slots=True, kw_only=True)
class SuccessFloor:
    """A success rate that is not to be fallen below."""

    rate: float  # from 0 to 1
    row: str = ""  # whose; "" = of all rows together

    @classmethod
    def of(cls, text: str) -> "SuccessFloor":
        """Return what "0.8", or "ROW=0.8", says.

        Raises:
            KarmaError: it says neither.
        """
        row, _, number = text.rpartition("=")
        try:
            rate = float(number)
        except ValueError:
            rate = -1.0
        if not 0.0 <= rate <= 1.0:
            fix = '--fail-under 0.8, or --fail-under "ROW=0.8"'
            raise KarmaError(f"--fail-under {text}: a rate is from 0 to 1\n  To fix: {fix}")
        return cls(rate=rate, row=row.strip())


def check_floors(floors: Sequence[SuccessFloor], rows: Sequence[str]) -> None:
    """Raise KarmaError where a floor is of a row that there is not."""
    for floor in floors:
        if floor.row and floor.row not in rows:
            there = ", ".join(map(repr, rows))
            hint = did_you_mean(floor.row, rows)
            raise KarmaError(f"--fail-under: no row {floor.row!r}.{hint} There are {there}")


def below(lines: Sequence[Figures], floors: Sequence[SuccessFloor]) -> list[str]:
    """Return in words which floors the success rates of a run are below.

    A rate is of the episodes that are judged; where there is none, nothing has succeeded.
    """
    found = []
    for floor in floors:
        mine = [line for line in lines if line.kind == ALL and floor.row in ("", line.row)]
        solved, done = sum(one.successes for one in mine), sum(one.episodes for one in mine)
        if not done or solved < floor.rate * done - 1e-9:
            who = floor.row or "all rows"
            rate = f"{solved / done:.3f}" if done else "none"
            found.append(f"success of {who}: {rate} ({solved} of {done}), below {floor.rate:g}")
    return found
