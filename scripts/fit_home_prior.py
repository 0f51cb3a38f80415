"""Fit what is known before a home is: how things move, where they are, what is asked for.

Training homes are drawn with seeds from 1,000,000 on, and those in which things are asked for have
numbers from 1,000 on; no evaluation uses either.

    python scripts/fit_home_prior.py --homes 90 --lived 50
"""

from collections import Counter, defaultdict
from typing import Annotated

import numpy as np
import typer
from rich.progress import track
from scipy.optimize import minimize

from karma.benchmarks.lived.experiment import LivedExperiment, LivedRow
from karma.benchmarks.lived.play import player
from karma.files import to_json, write_atomic
from karma.household.ids import type_of
from karma.infer.embed.minilm import MiniLm
from karma.memory.lived.ageing import (
    AT_NIGHT,
    BY_HOUR,
    DAY_S,
    HOUR_S,
    PRIOR,
    SURE,
    WEEK,
    AskedFor,
    HomePrior,
    TypePrior,
    home_prior,
)
from karma.seeds import stream
from karma.tasks.lived import Reader
from karma.world.houses import build_home
from karma.world.residents import Household

FIRST_SEED = 1_000_000
DISTURBANCES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
FIRST_LIVED = 1_000  # number of the first home that things are asked for in
FORMS = {  # how a thing is asked for -> kinds of requests
    "named": ("exact", "changed"),
    "described": ("attribute", "event", "several"),
    "told": ("place",),
}
STRENGTH_H = 300.0  # hours that the prior is worth
_DAYS = np.repeat(WEEK, 24)  # of a week that have each of the hours
LIKE_ALL = 20.0  # moves that the hours of all types are worth against those of one


def main(
    homes: Annotated[int, typer.Option(help="Training homes.")] = 60,
    lived: Annotated[int, typer.Option(help="Homes that things are asked for in.")] = 50,
) -> None:
    """Write `prior.json` from what residents do in training homes, and ask for in others."""
    types = _types(homes)
    write_atomic(PRIOR, to_json(HomePrior(homes=homes, types=types), indent=1))
    asked = _asked(lived)
    write_atomic(PRIOR, to_json(HomePrior(homes=homes, asked=asked, types=types), indent=1))
    print(f"{PRIOR}: {len(types)} types from {homes} homes; asked for in {lived}: {asked}")


def _types(homes: int) -> dict[str, TypePrior]:
    """Return how often each type moves, and where it is."""
    moves: defaultdict[str, np.ndarray] = defaultdict(lambda: np.zeros(48))  # by hour
    days: Counter[str] = Counter()
    places: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for number in track(range(homes), description="homes"):
        seed = FIRST_SEED + number
        rng = stream(seed, "home prior")
        scene = build_home(int(rng.integers(1, 9)), seed)
        household = Household(
            scene,
            seed=seed,
            people=int(rng.integers(1, 5)),
            disturbance=DISTURBANCES[number % len(DISTURBANCES)],
        )
        for day in range(sum(WEEK)):
            for deed in household.until((day + 1) * DAY_S):
                if deed.action == "PutObject":
                    moves[deed.object_type][_hour(deed.time_s)] += 1
            for seen in household.now().values():
                days[seen.object_type] += 1
                room = seen.room.rpartition("_")[0]
                places[seen.object_type][f"{room}/{type_of(seen.place_id)}"] += 1
    week_h, of_all = np.dot(_DAYS, BY_HOUR), sum(moves.values(), np.zeros(48))
    day_h = float(week_h) / sum(WEEK)
    return {
        name: TypePrior(
            moves=round(
                STRENGTH_H * (float(moves[name].sum()) + 0.2) / (days[name] * day_h + 50.0), 4
            ),
            hours=STRENGTH_H,
            places={
                place: round(times / sum(places[name].values()), 4)
                for place, times in sorted(places[name].items())
                if not place.endswith("/")
            },
            by_hour=_by_hour(moves[name] + LIKE_ALL * of_all / of_all.sum(), float(week_h)),
        )
        for name in sorted(days)
    }


def _hour(time_s: float) -> int:
    """Return which of the 48 hours of `by_hour` a time is in."""
    day, second = divmod(time_s, DAY_S)
    return int(second // HOUR_S) + 24 * (day % sum(WEEK) >= WEEK[0])


def _by_hour(moves: np.ndarray, week_h: float) -> tuple[float, ...]:
    """Return what each hour counts, for moves of weeks by hour; no hour counts nothing."""
    awake = week_h - AT_NIGHT * float(_DAYS.sum())
    shares = moves / moves.sum() / _DAYS
    return tuple(round(AT_NIGHT + awake * float(share), 3) for share in shares)


def _asked(homes: int) -> dict[str, AskedFor]:
    """Return what being asked for says: chances by age alone, against where things were."""
    home_prior.cache_clear()  # the file has no "asked" now
    row = LivedRow(name="ours", design="ours")
    experiment = LivedExperiment(
        name="prior", benchmark="lived", rows=(row,), homes=homes, first_home=FIRST_LIVED
    )
    embedder = MiniLm()
    play = player(experiment, embedder, Reader(embedder))
    found: defaultdict[str, list[tuple[float, bool]]] = defaultdict(list)
    for spec in track(list(experiment.specs()), description="requests"):
        for record in play(row.name, spec.name, 0):
            for one in record.requests:
                said = [(d.holds, d.was_so) for d in one.doubts if d.holds is not None]
                found[one.kind] += said
    return {
        form: _fitted([doubt for kind in kinds for doubt in found[kind]])
        for form, kinds in FORMS.items()
    }


def _fitted(doubts: list[tuple[float, bool]]) -> AskedFor:
    """Return the logistic function with the largest likelihood (Platt 1999)."""
    said = np.clip([holds for holds, _ in doubts], SURE, 1.0 - SURE)
    so = np.array([1.0 if was_so else -1.0 for _, was_so in doubts])
    odds = np.log(said / (1.0 - said))

    def loss(by: np.ndarray) -> float:
        return float(np.logaddexp(0.0, -so * (by[0] + by[1] * odds)).mean())

    shift, slope = minimize(loss, np.array([0.0, 1.0])).x
    return AskedFor(shift=round(float(shift), 2), slope=round(float(slope), 2))


if __name__ == "__main__":
    typer.run(main)
