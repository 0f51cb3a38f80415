"""Fit what is known of homes before one is known: how often things move, where they are.

Training homes are drawn with seeds from 1,000,000 on, which no evaluation uses.

    python scripts/fit_home_prior.py --homes 60
"""

from collections import Counter, defaultdict
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from karma.files import to_json, write_atomic
from karma.household.ids import type_of
from karma.memory.lived.ageing import PRIOR, HomePrior, TypePrior, waking_hours
from karma.seeds import stream
from karma.world.houses import build_home
from karma.world.residents import Household

FIRST_SEED = 1_000_000
DAYS = 5
DAY_S = 86_400.0
DISTURBANCES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
ASKED = 0.1  # of development homes: things believed nearly surely that were gone when asked for
STRENGTH_H = 30.0  # waking hours that the prior is worth


def main(
    homes: Annotated[int, typer.Option(help="Training homes.")] = 60,
    out: Annotated[Path, typer.Option(help="The file to write.")] = PRIOR,
) -> None:
    """Write `prior.json` from what residents do in training homes."""
    moves: Counter[str] = Counter()
    hours: defaultdict[str, float] = defaultdict(float)
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
        for day in range(DAYS):
            for deed in household.until((day + 1) * DAY_S):
                if deed.action == "PutObject":
                    moves[deed.object_type] += 1
            for seen in household.now().values():
                hours[seen.object_type] += waking_hours(0.0, DAY_S)
                room = seen.room.rpartition("_")[0]
                places[seen.object_type][f"{room}/{type_of(seen.place_id)}"] += 1
    found = {
        name: TypePrior(
            moves=round(STRENGTH_H * (moves[name] + 0.2) / (hours[name] + 50.0), 4),
            hours=STRENGTH_H,
            places={
                place: round(times / sum(places[name].values()), 4)
                for place, times in sorted(places[name].items())
                if not place.endswith("/")
            },
        )
        for name in sorted(hours)
    }
    write_atomic(out, to_json(HomePrior(homes=homes, asked=ASKED, types=found), indent=1))
    print(f"{out}: {len(found)} types from {homes} homes")


if __name__ == "__main__":
    typer.run(main)
