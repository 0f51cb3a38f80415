"""Check the paper's claims about its figures 4 to 7 against the results of each workload.

A verdict is "yes" or "no" where the 95 % interval decides, and "tie" where it does not. A
difference of hit rates counts from a tenth of a point on: over a hundred sequences far smaller ones
are sure.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Literal, NamedTuple

import msgspec

from karma.bench.figures.tables import Sheet
from karma.bench.policies.simulate import BELADY
from karma.bench.policies.sweep import (
    Bootstrapped,
    Exploration,
    PolicyRow,
    Resampler,
    Sweep,
)
from karma.bench.policies.tasks import UnitSet, Workload
from karma.errors import KarmaError
from karma.journal.formats import UNKNOWN, percent_text, range_text

FIFO = "fifo-merge"
SMALL, LARGE = 5, 25  # units, of the two ratios
MARGIN = 0.001  # of a hit rate; less is a tie
LINEAR = 0.8  # from this r on, two figures count as linearly related


class FigureCell(msgspec.Struct, frozen=True, kw_only=True):
    """Results of a workload with a unit set."""

    workload: Workload
    unit_set: UnitSet
    sweep: Sweep
    exploration: list[Exploration] = []


class PaperClaim(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict on a claim for a workload and a reading of a policy."""

    claim: str
    workload: str
    unit_set: str
    policy: str
    figures: list[tuple[str, str]]  # column and text
    short: str  # the figure that decides
    holds: Literal["yes", "no", "tie"]


Claims = Iterator[PaperClaim]
Say = Callable[..., PaperClaim]  # makes a claim of the cell at hand


def claims_of(names: Sequence[str], cells: Sequence[FigureCell]) -> list[PaperClaim]:
    """Return the verdicts of some claims; KarmaError if a claim has no such name."""
    for name in names:
        if name not in CLAIMS:
            raise KarmaError(f"no claim {name!r}; there are {', '.join(CLAIMS)}")
    return [
        found
        for name in names
        for cell in cells
        for found in CLAIMS[name].check(
            cell, partial(PaperClaim, claim=name, workload=cell.workload, unit_set=cell.unit_set)
        )
    ]


def claims_sheets(claims: Sequence[PaperClaim]) -> Iterator[tuple[str, Sheet]]:
    """Yield for each claim its name, and a table of its figures."""
    for name in dict.fromkeys(claim.claim for claim in claims):
        mine = [claim for claim in claims if claim.claim == name]
        yes = sum(claim.holds == "yes" for claim in mine)
        yield name, Sheet(
            title=CLAIMS[name].text,
            caption=f"Holds in {yes} of {len(mine)} cases.",
            head=("workload", "units", "policy", *(word for word, _ in mine[0].figures), "holds"),
            lines=tuple(
                (one.workload, one.unit_set.upper(), one.policy,
                 *(text for _, text in one.figures), one.holds)
                for one in mine
            ),
        )  # fmt: skip


def claims_text(claims: Sequence[PaperClaim], caption: str) -> str:
    """Return the verdicts as Markdown: for each claim a table by workload, and one of figures."""
    parts = []
    for name, sheet in claims_sheets(claims):
        parts += [
            f"**{sheet.title}** {sheet.caption} In brackets: {CLAIMS[name].brackets}.",
            _by_workload([claim for claim in claims if claim.claim == name]),
            _table(sheet.head, sheet.lines),
        ]
    return "\n\n".join([*parts, caption + "."]) + "\n"


def _by_workload(claims: Sequence[PaperClaim]) -> str:
    workloads = list(dict.fromkeys(claim.workload for claim in claims))
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for claim in claims:
        row = "best of all" if claim.claim == "headroom" else claim.policy
        text = f"{claim.holds} ({claim.short})"
        rows.setdefault((row, claim.unit_set), {})[claim.workload] = text
    lines = [
        (policy, unit_set.upper(), *(found.get(one, "–") for one in workloads))
        for (policy, unit_set), found in sorted(rows.items(), key=lambda row: row[0][0])
    ]
    return _table(("policy", "units", *workloads), lines)


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = (head, ["---"] * len(head), *lines)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def _split(cell: FigureCell, say: Say) -> Claims:
    """Compare [9,1] with the other splits of ten lines, and with FIFO."""
    rows = {row.policy: row for row in cell.sweep.rows}
    for policy, row in rows.items():
        if "[9,1]" not in policy:
            continue
        family = row.name.family
        others = [
            other
            for other in rows.values()
            if other is not row and other.size == row.size and other.name.family == family
        ]
        fifo, bound = rows.get(f"{FIFO}[10]"), rows.get(f"{BELADY}[10]")
        if not others or fifo is None:
            continue
        best = max(others, key=lambda other: sum(_rates(cell.sweep, other)))
        gains = [_gain(cell.sweep, row, other) for other in (*others, fifo)]
        steady = [_gain(cell.sweep, row, other, steady=True) for other in (*others, fifo)]
        yield say(
            policy=family,
            figures=[
                ("[9,1]", _percent(row.cold)),
                ("best other split", f"{best.name.division}: {_percent(best.cold)}"),
                ("FIFO", _percent(fifo.cold)),
                ("Belady", _percent(bound.cold if bound else None)),
                ("over best split", _points(_gain(cell.sweep, row, best))),
                ("over FIFO", _points(gains[-1])),
                ("steady half", _verdict(steady)),
            ],
            short=f"{100 * _gain(cell.sweep, row, best).value:+.1f}, {100 * gains[-1].value:+.1f}",
            holds=_verdict(gains),
        )  # fmt: skip


def _verdict(gains: Sequence[Bootstrapped]) -> Literal["yes", "no", "tie"]:
    """Return whether all differences are gains."""
    if all(gain.above(MARGIN) for gain in gains):
        return "yes"
    below = any(gain.high is not None and gain.high < -MARGIN for gain in gains)
    return "no" if below else "tie"


def _ratio(cell: FigureCell, say: Say, *, wanted: float, queues: bool) -> Claims:
    """Compare 25 units with 5."""
    families: dict[str, dict[int, PolicyRow]] = {}
    for row in cell.sweep.rows:
        families.setdefault(row.name.line, {})[row.size] = row
    bound = _size_ratio(cell.sweep, families.get(BELADY, {}))
    for family, sizes in families.items():
        ratio = _size_ratio(cell.sweep, sizes)
        if ratio is None or family.startswith("fifo") != queues or family == BELADY:
            continue
        yield say(
            policy=family,
            figures=[
                ("5 units", _percent(sizes[SMALL].cold)),
                ("25 units", _percent(sizes[LARGE].cold)),
                ("ratio", _ratio_text(ratio)),
                ("Belady's ratio", _ratio_text(bound)),
            ],
            short=f"{ratio.value:.2f}",
            holds="yes" if ratio.holds(wanted) else "no",
        )


def _size_ratio(sweep: Sweep, sizes: Mapping[int, PolicyRow]) -> Bootstrapped | None:
    if SMALL not in sizes or LARGE not in sizes:
        return None
    large, small = _rates(sweep, sizes[LARGE]), _rates(sweep, sizes[SMALL])
    return _resampler(sweep).ratio(large, small) if sum(small) else None


def _linear(cell: FigureCell, say: Say) -> Claims:
    for found in cell.exploration:
        if found.r is None or found.policy.startswith(BELADY):
            continue
        yield say(
            policy=found.policy,
            figures=[
                ("r", _ratio_text(found.r, 3)),
                ("slope", f"{found.slope:.2f}"),
                ("hit rate", f"{100 * sum(found.rates) / len(found.rates):.1f}"),
                ("reduced exploration", f"{100 * sum(found.reduced) / len(found.reduced):.1f}"),
            ],
            short=f"{found.r.value:.2f}",
            holds=_is_linear(found.r),
        )


def _is_linear(r: Bootstrapped) -> Literal["yes", "no", "tie"]:
    if r.above(LINEAR):
        return "yes"
    return "no" if r.high is not None and r.high < LINEAR else "tie"


def _headroom(cell: FigureCell, say: Say) -> Claims:
    """Compare the best policy of ten lines with the bound."""
    rows = [row for row in cell.sweep.rows if row.size == 10 and row.name.family != "unbounded"]
    bound = next((row for row in rows if row.policy.startswith(BELADY)), None)
    rows = [row for row in rows if row is not bound]
    if bound is None or not rows:
        return
    best = max(rows, key=lambda row: sum(_rates(cell.sweep, row)))
    gap = _gain(cell.sweep, bound, best)
    yield say(
        policy=best.policy,
        figures=[
            ("best", _percent(best.cold)),
            ("Belady", _percent(bound.cold)),
            ("headroom", _points(gap)),
        ],
        short=f"{best.policy}, {100 * gap.value:+.1f}",
        holds=_verdict([gap]),
    )  # fmt: skip


class _Claim(NamedTuple):
    text: str
    brackets: str  # what stands in them beside a verdict
    check: Callable[[FigureCell, Say], Claims]


CLAIMS = {
    "split": _Claim(
        "At 10 units W-TinyLFU with window 9 and main 1 has the highest hit rate of all "
        "splits, and a higher one than FIFO (section 4.4).",
        "points over the best other split, and over FIFO",
        _split,
    ),
    "fifo-ratio": _Claim(
        "FIFO with 25 units hits 4.6 times as often as with 5 (section 4.4).",
        "the ratio",
        partial(_ratio, wanted=4.6, queues=True),
    ),
    "wtinylfu-ratio": _Claim(
        "W-TinyLFU with 25 units hits 3.9 times as often as with 5 (section 4.4).",
        "the ratio",
        partial(_ratio, wanted=3.9, queues=False),
    ),
    "linear": _Claim(
        f"Hit rate and reduced exploration are linearly related (section 4.4); r > {LINEAR}.",
        "Pearson's r",
        _linear,
    ),
    "headroom": _Claim(
        "A clairvoyant memory would hit more often than the best of these policies (which "
        "the paper does not say).",
        "the best policy, and points from there to Belady's bound",
        _headroom,
    ),
}


# ------------------------------------------------------------- figures as text


def _rates(sweep: Sweep, row: PolicyRow, *, steady: bool = False) -> list[float]:
    hits = row.steady_hits if steady else row.hits
    requests = sweep.steady_requests if steady else sweep.requests
    return [hit / asked if asked else 0.0 for hit, asked in zip(hits, requests, strict=True)]


def _gain(sweep: Sweep, row: PolicyRow, other: PolicyRow, *, steady: bool = False) -> Bootstrapped:
    """Return how much more often one hits than another, paired by sequence."""
    ours, theirs = _rates(sweep, row, steady=steady), _rates(sweep, other, steady=steady)
    return _resampler(sweep).mean([a - b for a, b in zip(ours, theirs, strict=True)])


def _resampler(sweep: Sweep) -> Resampler:
    return Resampler(len(sweep.requests), 0)


def _percent(rate: Bootstrapped | None) -> str:
    return percent_text(rate.value if rate else None, 1)


def _points(gain: Bootstrapped) -> str:
    text = f"{100 * gain.value:+.2f}"
    if gain.low is None or gain.high is None:
        return text
    return f"{text} [{100 * gain.low:+.2f}, {100 * gain.high:+.2f}]"


def _ratio_text(ratio: Bootstrapped | None, digits: int = 2) -> str:
    return UNKNOWN if ratio is None else range_text(ratio.value, ratio.low, ratio.high, digits)
