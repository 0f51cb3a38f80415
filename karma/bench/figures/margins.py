"""Whether a run bears out what the paper says of KARMA: its margins, held against ours."""

from collections.abc import Iterator
from dataclasses import dataclass

from karma.agent.journal.formats import figure_text
from karma.bench.figures.columns import COLUMNS
from karma.bench.figures.compare import Comparison
from karma.bench.figures.sheet import Sheet
from karma.bench.figures.statistics import Estimate, interval_text
from karma.bench.figures.tables import Result

EXPERT = "expert"  # the row that is no baseline
_OVER_BASELINES = {"composite": 1.3, "complex": 2.3}  # SR over the best baseline's (§4.3)
_SAVED = {"composite": {"re": 0.902, "rt": 0.687}, "complex": {"re": 0.867, "rt": 0.690}}  # Table 1
_WITHOUT_MEMORY = 1.0  # the paper gives no margin over the same agent without memory


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """One margin and what a run says of it."""

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


def margins(result: Result) -> list[Margin]:
    """Return the margins of the first row of a run; those that its rows allow."""
    return [*_of_success(result), *_of_savings(result)]


def margin_sheet(result: Result) -> Sheet | None:
    """Return the margins as a table; None where a run has nothing to say of them."""
    found = margins(result)
    if not found:
        return None
    return Sheet(
        title=f"{result.name}: the paper's margins",
        caption=(
            '"not surely": the 95 % interval reaches over the wanted value. Undefined: no baseline '
            "solved anything, or there was nothing to save. The paper gives no margin over the "
            "same agent without memory; 1 says that memory helps."
        ),
        head=("margin", "against", "wanted", "ours", "holds"),
        lines=tuple(
            (one.text, one.rival, figure_text(one.wanted), interval_text(one.ours), one.verdict)
            for one in found
        ),
    )


def _of_success(result: Result) -> Iterator[Margin]:
    twins = {line.reference for line in result.reductions}
    for kind, wanted in _OVER_BASELINES.items():
        mine = [one for one in result.comparisons if one.kind == kind]
        if rivals := [one for one in mine if _is_baseline(one, twins)]:
            best = max(rivals, key=lambda one: one.success.second.value or 0.0)
            text = f"SR of {best.first}, {kind} tasks, times that of the best baseline"
            yield Margin(text=text, wanted=wanted, ours=best.ratio, rival=best.second)
        for one in mine:
            if one.second in twins:
                text = f"SR of {one.first}, {kind} tasks, times that without memory"
                yield Margin(text=text, wanted=_WITHOUT_MEMORY, ours=one.ratio, rival=one.second)


def _is_baseline(one: Comparison, twins: set[str]) -> bool:
    """Return whether the second arm is a baseline: no ablation, no twin, not the expert."""
    return one.second not in {EXPERT, *twins} and not one.second.startswith(one.first)


def _of_savings(result: Result) -> Iterator[Margin]:
    first = result.figures[0].row if result.figures else ""
    for kind in _OVER_BASELINES:
        for one in (*result.reductions, *result.paper_reductions):
            if (one.row, one.kind) == (first, kind):
                for key in ("re", "rt", "re_related", "rt_related"):
                    wanted = _SAVED[kind][key.removesuffix("_related")]
                    text = f"{COLUMNS[key].title} of {first}, {kind} tasks"
                    ours = one.values[key]
                    yield Margin(text=text, wanted=wanted, ours=ours, rival=one.reference)
