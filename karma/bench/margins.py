"""Whether a run bears out what the paper says of KARMA: its margins, held against ours."""

from collections.abc import Iterator
from dataclasses import dataclass

from karma.bench.compare import Comparison
from karma.bench.statistics import Estimate
from karma.bench.tables import Result, Sheet, figure_text, interval_text

EXPERT = "expert"
_MARGINS = (("composite", 1.3), ("complex", 2.3))  # SR over the best baseline's (§4.3)
_SAVED = (  # Table 1, a little rounded down
    ("RE", "explorations", 0.85),
    ("RT", "actions", 0.65),
    ("RE related", "explorations_related", 0.85),
    ("RT related", "actions_related", 0.65),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """One margin of the paper and what a run says of it."""

    text: str
    wanted: float  # at least
    ours: Estimate
    rival: str = ""  # the row it is measured against

    @property
    def verdict(self) -> str:
        """Whether it holds, and whether its whole interval does."""
        value, interval = self.ours.value, self.ours.interval
        if value is None:
            return "undefined"
        if value < self.wanted:
            return "no" if interval is None or interval.high < self.wanted else "no, not surely"
        return "yes" if interval is not None and interval.low >= self.wanted else "yes, not surely"


def claims(result: Result) -> list[Claim]:
    """Return the paper's margins for the first row of a run; those that its rows allow."""
    return [*_margins(result), *_saved(result)]


def claim_sheet(result: Result) -> Sheet | None:
    """Return the claims as a table; None where a run has nothing to say of them."""
    found = claims(result)
    if not found:
        return None
    return Sheet(
        title=f"{result.name}: the paper's margins",
        caption=(
            '"not surely": the 95 % interval reaches over the wanted value. Undefined: no baseline '
            "solved anything, or there was nothing to save."
        ),
        head=("claim", "against", "wanted", "ours", "holds"),
        lines=tuple(
            (one.text, one.rival, figure_text(one.wanted), interval_text(one.ours), one.verdict)
            for one in found
        ),
    )


def _margins(result: Result) -> Iterator[Claim]:
    for kind, wanted in _MARGINS:
        rivals = [one for one in result.comparisons if one.kind == kind and _is_rival(result, one)]
        if rivals:
            best = max(rivals, key=_solved_by_second)
            text = f"SR of {best.first}, {kind} tasks, times that of the best baseline"
            yield Claim(text=text, wanted=wanted, ours=best.ratio, rival=best.second)


def _is_rival(result: Result, one: Comparison) -> bool:
    """Return whether the second arm is a baseline: no ablation, no twin, not the expert."""
    twins = {line.reference for line in result.reductions}
    return one.second not in {EXPERT, *twins} and not one.second.startswith(one.first)


def _solved_by_second(one: Comparison) -> float:
    line = next(line for line in one.lines if line.key == "success")
    return line.second.value or 0.0


def _saved(result: Result) -> Iterator[Claim]:
    first = result.figures[0].row if result.figures else ""
    for kind, _ in _MARGINS:
        for one in (*result.reductions, *result.paper_reductions):
            if (one.row, one.kind) == (first, kind):
                for title, field, wanted in _SAVED:
                    estimate: Estimate = getattr(one, field)
                    text = f"{title} of {first}, {kind} tasks"
                    yield Claim(text=text, wanted=wanted, ours=estimate, rival=one.reference)
