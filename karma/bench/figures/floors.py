"""Success rates that a run must reach."""

from collections.abc import Sequence
from dataclasses import dataclass

from karma.agent.journal.records import ALL
from karma.bench.figures.columns import Figures
from karma.errors import KarmaError, did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class SuccessFloor:
    """The lowest success rate that passes."""

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
