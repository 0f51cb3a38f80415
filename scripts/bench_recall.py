"""Measure milliseconds per recall in memories of 10, 1,000 and 100,000 units.

    OMP_NUM_THREADS=1 python scripts/bench_recall.py [--repeats 20] [--units 10 --units 1000]

Seconds of the processor, medians.

- texts: every unit has a random vector of 384 numbers, as in the paper's `cosine` over listings.
  `kept` is the index, `changed` the same after a unit was added and another removed;
  the reference `numpy` is a matrix product and a partition over the same vectors.
- kinds: units of the 119 types that words are known of, with states and places, asked by
  `stateful` in a phrase; `encoder` adds MiniLM, which reads each phrase for the first time.
"""

from collections.abc import Callable
from itertools import count
from statistics import median
from typing import Annotated

import numpy as np
import typer
from measuring import in_turns, table

from karma.loading.models import Models, load_resources
from karma.memory.recall import UnitIndex
from karma.offline.guard import go_offline
from karma.plugins.rules.language.lexemes import lexicon
from karma.seeds import stream
from karma.types.memory import MemoryUnit
from karma.types.roles import Recall

DIMENSION, K = 384, 3
STATES = ((), ("cleaned",), ("dirty",), ("sliced",), ("cleaned", "sliced"), ("filled",))
PLACES = ("CounterTop|1", "Fridge|1", "Shelf|2", "Desk|1", "Sink|1", None)
ASKED = ("the clean mug from the fridge", "put the red fruit on the desk", "the dirty pan")
Ways = dict[str, Callable[[], object]]


def own_texts(number: int, repeats: int) -> Ways:
    """Return the index, kept and changed, and NumPy over units with a vector each."""
    rng = stream(0, "bench", str(number))
    rows = rng.standard_normal((number + repeats, DIMENSION), dtype=np.float32)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    units = [unit(at, "Mug") for at in range(len(rows))]
    index = UnitIndex(lambda at: rows[at : at + 1], lambda one: int(one.object_id))
    memory, coming, turn = units[:number], iter(units[number:]), count()
    index.follow(memory)
    questions = [row[None] + rows[0] for row in rng.standard_normal((3, DIMENSION)) / 30]
    asked = [(q / np.linalg.norm(q)).astype(np.float32) for q in questions]

    def kept() -> None:
        index.follow(memory)
        index.best(asked[next(turn) % 3], K)

    def changed() -> None:
        memory[:] = [*memory[1:], next(coming)]
        kept()

    def plain() -> None:
        scores = rows[:number] @ asked[next(turn) % 3][0]
        best = np.argpartition(-scores, min(K, number - 1))[:K]
        best[np.argsort(-scores[best], kind="stable")]

    kept()  # what the first call sets up is there
    return {"kept": kept, "changed": changed, "numpy": plain}


def kinds(recall: Recall, number: int, repeats: int) -> Ways:
    """Return `stateful` over kinds: as it is, with a unit that changed, with phrases never read."""
    names = sorted(lexicon())
    units = [unit(at, names[at % len(names)]) for at in range(number + repeats)]
    memory, coming, turn = units[:number], iter(units[number:]), count()
    new = (f"the {number}th {n} of my aunt" for one in lexicon().values() for n in one.names)
    for text in ASKED:
        recall.recall(text, memory, K)

    def changed() -> None:
        memory[:] = [*memory[1:], next(coming)]
        recall.recall(ASKED[next(turn) % 3], memory, K)

    return {
        "kinds": lambda: recall.recall(ASKED[next(turn) % 3], memory, K),
        "changed": changed,
        "encoder": lambda: recall.recall(next(new), memory, K),
    }


def unit(number: int, kind: str) -> MemoryUnit:
    """Return a unit with some state and place."""
    return MemoryUnit(
        object_id=str(number), object_type=kind, position_m=(0.0, 0.0, 0.0),
        states=STATES[number % len(STATES)], place_id=PLACES[number // 7 % len(PLACES)],
        handled=number % 3 == 0,
    )  # fmt: skip


def medians(ways: Ways, repeats: int) -> list[float]:
    """Return the median milliseconds of each way."""
    return [1000 * median(in_turns({n: way}, repeats)[n]) for n, way in ways.items()]


def main(units: Annotated[list[int] | None, typer.Option()] = None, repeats: int = 20) -> None:
    """Print a table for each kind of memory."""
    go_offline()
    sizes = units or [10, 1000, 100_000]
    found = ((n, *medians(own_texts(n, repeats), repeats)) for n in sizes)
    table("units | kept | changed | numpy | kept : numpy", ((*f, f[1] / f[3]) for f in found))
    recall = load_resources(Models(), maps=None, seed=0).recall
    print()
    table(
        "units | kinds | changed | with encoder",
        ((n, *medians(kinds(recall, n, repeats), repeats)) for n in sizes),
    )


if __name__ == "__main__":
    typer.run(main)
