"""Add up days: success by kind of request, stale beliefs, doubt, effort; homes are the units."""

import heapq
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from karma.bench.figures.statistics import bootstrap, rate, times_in
from karma.bench.figures.tables import Sheet
from karma.journal.formats import UNKNOWN, figure_text, range_text
from karma.plugins.homes.lived.experiment import LivedExperiment
from karma.plugins.homes.lived.request import LivedKind, LivedRecord, ServedRequest
from karma.seeds import stream

ALL = "all"
KINDS: tuple[str, ...] = (*get_args(LivedKind), ALL)
OURS = "ours"
_COUNTS = ("actions", "places", "wasted", "repairs", "tokens")  # told per request
_RESAMPLES = 2_000  # of homes, for differences


@dataclass(frozen=True, slots=True, kw_only=True)
class KindFigures:
    """How often one kind of request was served rightly."""

    kind: str
    requests: int
    right: float | None
    low: float | None  # ends of the interval over homes
    high: float | None
    unknown: float | None  # share in which it said that it does not know, or gave up
    against_ours: float | None = None  # ours minus this row, paired by home
    against_low: float | None = None
    against_high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedFigures:
    """What a row's days under one setting come to."""

    row: str
    setting: str
    homes: int
    days: int
    moved: float  # share of movable things that residents moved on a day
    kinds: tuple[KindFigures, ...]
    stale_share: float | None  # world actions spent on a belief that was false, of all for requests
    stale_looks: float | None  # of the looks made on a belief, those where it was false
    actions: float  # per request
    places: float  # looked at, per request
    wasted: float  # of them in vain, per request
    repairs: float
    tokens: float  # of facts, per request
    brier: float | None  # of "it is still there"; a row without a notion of it counts as sure
    brier_assumed: bool  # the row has none
    reliability: tuple[tuple[float, float, int], ...]  # mean said, share that was so, number
    knew: float | None  # requests for a thing that memory had where it was
    seen_there: float | None  # that the robot had seen where it was
    at_best: float | None  # that the units of this setting could have known, see `bound`
    units: int
    memory_bytes: float  # at the end of the last day, mean over homes
    read: float  # share of requests whose words were understood
    missing: int  # requests that homes had no occasion for
    errors: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StaleShare:
    """What part of a row's actions under one setting went to beliefs that were false."""

    row: str
    setting: str
    share: float | None
    low: float | None  # ends of the interval over resampled homes
    high: float | None


def stale_shares(records: Sequence[LivedRecord]) -> list[StaleShare]:
    """Return the stale actions of each row under each setting, with intervals."""
    groups: dict[tuple[str, str], list[LivedRecord]] = {}
    for record in records:
        groups.setdefault((record.row, record.setting), []).append(record)
    return [_stale_share(row, setting, mine) for (row, setting), mine in groups.items()]


def _stale_share(row: str, setting: str, records: Sequence[LivedRecord]) -> StaleShare:
    homes = [
        (sum(one.stale_actions for one in served), sum(one.actions for one in served))
        for served in _by_home(records).values()
    ]
    stale, actions = np.array(homes, dtype=float).T
    low, high = _resampled(stale, actions, "stale")
    share = float(stale.sum() / actions.sum()) if actions.any() else None
    return StaleShare(row=row, setting=setting, share=share, low=low, high=high)


def by_day(records: Sequence[LivedRecord]) -> list[LivedRecord]:
    """Return the records with the days lived as their settings."""
    return [replace(one, setting=f"day {one.day + 1}") for one in records]


def figures_of(records: Sequence[LivedRecord]) -> list[LivedFigures]:
    """Return the figures of each row under each setting, rows in their order."""
    found = []
    for setting in dict.fromkeys(record.setting for record in records):
        here = [record for record in records if record.setting == setting]
        ours = _by_home([one for one in here if one.row == OURS])
        for row in dict.fromkeys(record.row for record in here):
            mine = [one for one in here if one.row == row]
            found.append(_figures(row, setting, mine, {} if row == OURS else ours))
    return found


def _by_home(records: Iterable[LivedRecord]) -> dict[tuple[int, int], list[ServedRequest]]:
    homes: dict[tuple[int, int], list[ServedRequest]] = {}
    for record in records:
        homes.setdefault((record.home, record.seed), []).extend(record.requests)
    return homes


def _figures(
    row: str, setting: str, records: Sequence[LivedRecord],
    ours: dict[tuple[int, int], list[ServedRequest]],
) -> LivedFigures:  # fmt: skip
    homes = _by_home(records)
    requests = [one for served in homes.values() for one in served]
    number = max(len(requests), 1)
    actions = sum(one.actions for one in requests)
    believed = sum(one.believed for one in requests)
    doubts = [doubt for one in requests for doubt in one.doubts]
    placed = [one for one in requests if one.knew is not None]
    units = max((record.units for record in records), default=0)
    last = max((record.day for record in records), default=0)
    said = [1.0 if doubt.holds is None else doubt.holds for doubt in doubts]
    so = [float(doubt.was_so) for doubt in doubts]
    return LivedFigures(
        row=row,
        setting=setting,
        homes=len(homes),
        days=len(records),
        moved=_mean(record.moved for record in records) or 0.0,
        kinds=tuple(_kind(kind, homes, ours) for kind in KINDS),
        stale_share=sum(one.stale_actions for one in requests) / actions if actions else None,
        stale_looks=sum(one.stale for one in requests) / believed if believed else None,
        **{name: sum(getattr(one, name) for one in requests) / number for name in _COUNTS},
        brier=_mean((a - b) ** 2 for a, b in zip(said, so, strict=True)),
        brier_assumed=any(doubt.holds is None for doubt in doubts),
        reliability=tuple(_reliability(said, so)),
        knew=_mean(float(bool(one.knew)) for one in placed),
        seen_there=_mean(float(one.known_s is not None) for one in placed),
        at_best=sum(_at_best(served, units) for served in homes.values()) / len(placed)
        if placed
        else None,
        units=units,
        memory_bytes=_mean(one.memory_bytes for one in records if one.day == last) or 0.0,
        read=_mean(float(one.read) for one in requests) or 0.0,
        missing=sum(record.missing for record in records),
        errors=sum(bool(record.error) for record in records),
    )


def _at_best(served: Iterable[ServedRequest], units: int) -> int:
    """Return how many of a home's requests so many units could have known."""
    known = [(one.known_s, one.time_s) for one in served if one.known_s is not None]
    return most_known(known, units)


def _mean(values: Iterable[float]) -> float | None:
    found = list(values)
    return sum(found) / len(found) if found else None


def _kind(
    kind: str,
    homes: dict[tuple[int, int], list[ServedRequest]],
    ours: dict[tuple[int, int], list[ServedRequest]],
) -> KindFigures:
    def of(served: Iterable[ServedRequest]) -> list[ServedRequest]:
        return [one for one in served if kind in (ALL, one.kind)]

    groups = [[float(one.right) for one in of(served)] for served in homes.values()]
    found = rate([group for group in groups if group])
    requests = [one for served in homes.values() for one in of(served)]
    pairs = [
        (
            _mean(float(one.right) for one in of(ours[home])),
            _mean(float(one.right) for one in of(served)),
        )
        for home, served in homes.items()
        if home in ours
    ]
    differences = [a - b for a, b in pairs if a is not None and b is not None]
    low, high = _resampled(differences, np.ones(len(differences)), kind)
    return KindFigures(
        kind=kind,
        requests=len(requests),
        right=found.value,
        low=found.interval.low if found.interval else None,
        high=found.interval.high if found.interval else None,
        unknown=_mean(float(one.unknown) for one in requests),
        against_ours=_mean(differences),
        against_low=low,
        against_high=high,
    )


def _resampled(
    over: ArrayLike, under: NDArray[np.float64], use: str
) -> tuple[float | None, float | None]:
    """Return the ends of the 95 % interval of a ratio of sums over resampled homes."""
    if not len(under) or not under.all():
        return None, None
    times = times_in(stream(0, "lived", "resampled", use), len(under), _RESAMPLES)
    sums = np.column_stack([np.asarray(over, float), under])
    found = bootstrap(sums, lambda s: s[:, 0] / s[:, 1], number=len(under), times=times)
    ends = found.interval
    return (ends.low, ends.high) if ends else (None, None)


def _reliability(said: Sequence[float], so: Sequence[float]) -> Iterator[tuple[float, float, int]]:
    """Yield tenths of what was said: its mean, the share that was so, how many."""
    tenths = np.minimum((np.array(said) * 10).astype(int), 9) if said else np.zeros(0, dtype=int)
    for tenth in range(10):
        mine = np.flatnonzero(tenths == tenth)
        if len(mine):
            yield (
                float(np.array(said)[mine].mean()),
                float(np.array(so)[mine].mean()),
                len(mine),
            )


# ----------------------------------------------------------------- tables


def kinds_sheet(figures: Sequence[LivedFigures]) -> Sheet:
    """Return success by kind of request."""
    return Sheet(
        title="Requests served rightly, by kind",
        caption="Shares with 95 % intervals that keep a home's requests together. exact: where it "
        "was last seen; attribute: told by its state; event: by a deed; time: of the past; place: "
        "told by where it is; count; several: two memories; changed: not where the rounds showed "
        "it last; unseen: none in this home, right is to say so. Judged by the world's truth.",
        head=("row", "setting", *KINDS),
        lines=tuple(
            (one.row, one.setting, *(range_text(k.right, k.low, k.high) for k in one.kinds))
            for one in figures
        ),
    )


def truth_sheet(figures: Sequence[LivedFigures]) -> Sheet:
    """Return how ours compares by kind, paired by home."""
    return Sheet(
        title="Ours minus the row, paired by home",
        caption="Difference of shares, in brackets the 95 % interval over resampled homes.",
        head=("row", "setting", *KINDS),
        lines=tuple(
            (one.row, one.setting, *(_difference(kind) for kind in one.kinds))
            for one in figures
            if one.row != OURS
        ),
    )


def work_sheet(figures: Sequence[LivedFigures]) -> Sheet:
    """Return stale beliefs, doubt and effort."""
    return Sheet(
        title="Stale beliefs, doubt, effort",
        caption="Stale actions: of the world actions for requests, those spent on going where "
        "memory said that a thing is, and it was not. Stale looks: of such looks, those in vain. "
        "Brier: of the chance that a fact still holds (lower is better; * a row that gives none, "
        "taken as sure). Per request: world actions, places looked at, of them in vain, plans made "
        "anew, tokens of facts. KiB: of memory at the end. Moved: things moved by people on a day.",
        head=("row", "setting", "stale actions", "stale looks", "Brier", "actions", "places",
              "in vain", "anew", "tokens", "KiB", "moved", "read", "homes"),
        lines=tuple(_work(one) for one in figures),
    )  # fmt: skip


def known_sheet(figures: Sequence[LivedFigures]) -> Sheet:
    """Return what memory knew, and what it could have known."""
    return Sheet(
        title="Where the thing is that is asked for",
        caption="Of the requests for a thing: knew: what memory took to be meant was, and lay "
        "where memory had it; seen there: the robot had seen it where it is; at best: so many "
        "units that know the future could have known, from the truth.",
        head=("row", "setting", "knew", "seen there", "at best", "units"),
        lines=tuple(
            (one.row, one.setting, figure_text(one.knew), figure_text(one.seen_there),
             figure_text(one.at_best), str(one.units))
            for one in figures
        ),
    )  # fmt: skip


def _work(one: LivedFigures) -> tuple[str, ...]:
    brier = UNKNOWN if one.brier is None else f"{one.brier:.3f}{'*' if one.brier_assumed else ''}"
    return (
        one.row, one.setting, _share(one.stale_share), _share(one.stale_looks), brier,
        figure_text(one.actions, 1), figure_text(one.places), figure_text(one.wasted),
        figure_text(one.repairs), figure_text(one.tokens, 0),
        figure_text(one.memory_bytes / 1024, 1), f"{one.moved:.2f}", f"{one.read:.2f}",
        str(one.homes),
    )  # fmt: skip


def _difference(kind: KindFigures) -> str:
    if kind.against_ours is None:
        return UNKNOWN
    if kind.against_low is None or kind.against_high is None:
        return f"{kind.against_ours:+.2f}"
    return f"{kind.against_ours:+.2f} [{kind.against_low:+.2f}, {kind.against_high:+.2f}]"


def _share(value: float | None) -> str:
    return UNKNOWN if value is None else f"{100 * value:.1f} %"


def remarks_on(experiment: LivedExperiment) -> list[str]:
    """Return what a reader of the table has to know about how it was made."""
    return [
        "Things are called by names that the reader knows, under a setting of held-out words by "
        "names that no training had. One reader and one planner, both by rules, serve all rows "
        f"with at most {experiment.tokens} tokens of facts a question; no language model is asked.",
        "expert: the truth of now for everything ever seen, through the same reader and planner.",
    ]


def most_known(waits: Iterable[tuple[float, float]], units: int) -> int:
    """Return how many requests so many units could at best have served.

    `waits`: of each request, when its thing was seen last and when it is asked for, seconds.

    >>> most_known([(0, 9), (1, 4), (2, 5), (5, 8)], 1), most_known([(0, 9), (1, 4), (2, 5)], 2)
    (2, 2)
    """
    held: list[tuple[float, float]] = []  # the one that is wanted last stands first: -end, start
    served = 0
    for start, end in sorted(waits):
        done = [one for one in held if -one[0] <= start]
        if done:
            held = [one for one in held if -one[0] > start]
            heapq.heapify(held)
            served += len(done)
        heapq.heappush(held, (-end, start))
        if len(held) > units:
            heapq.heappop(held)
    return served + len(held)
