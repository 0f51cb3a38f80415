"""Milliseconds of one question to recall, in memories of 10, 1,000 and 100,000 units.

    OMP_NUM_THREADS=1 python scripts/bench_recall.py [--units 10 1000 100000] [--repeats 20]

Processor time of this process, so that other work on the machine counts less; medians.

- texts of their own: every unit has a vector of its own, random ones of 384 numbers, as the paper's
  `cosine` over listings has it. `kept` is the index, `changed` the same after one unit came and one
  went, `numpy` one matrix product and a partition over the same vectors.
- kinds: units of the 119 types that words are known of, with states and places, asked by
  `stateful` in a phrase; `encoder` adds MiniLM, which reads each phrase for the first time.
"""

import argparse
from collections.abc import Callable, Iterator
from statistics import median
from time import process_time

import numpy as np

from karma.contracts import MemoryUnit, Recall
from karma.loading.models import Models, load_resources
from karma.memory.index import UnitIndex
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.drawing.lexicon import lexicon

DIMENSION, K = 384, 3
STATES = ((), ("cleaned",), ("dirty",), ("sliced",), ("cleaned", "sliced"), ("filled",))
PLACES = ("CounterTop|1", "Fridge|1", "Shelf|2", "Desk|1", "Sink|1", None)
ASKED = ("the clean mug from the fridge", "put the red fruit on the desk", "the dirty pan")


def main() -> None:
    """Print a table for each kind of memory."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--units", type=int, nargs="+", default=[10, 1000, 100_000])
    parser.add_argument("--repeats", type=int, default=20)
    arguments = parser.parse_args()
    go_offline()
    print("| units | kept | changed | numpy | kept : numpy |\n|---|---|---|---|---|")
    for count in arguments.units:
        kept, changed, plain = own_texts(count, arguments.repeats)
        print(f"| {count:,} | {kept:.2f} | {changed:.2f} | {plain:.2f} | {kept / plain:.2f} |")
    recall, new = load_resources(Models(), maps=None, seed=0).recall, fresh_phrases()
    print("\n| units | kinds | changed | with encoder |\n|---|---|---|---|")
    for count in arguments.units:
        asked, changed, encoded = kinds(recall, count, arguments.repeats, new)
        print(f"| {count:,} | {asked:.2f} | {changed:.2f} | {encoded:.2f} |")


def own_texts(count: int, repeats: int) -> tuple[float, float, float]:
    """Time the index, kept and changed, and NumPy over units with a vector each."""
    rng = stream(0, "bench", str(count))
    rows = rng.standard_normal((count + repeats, DIMENSION), dtype=np.float32)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    units = [unit(number, "Mug") for number in range(len(rows))]
    index = UnitIndex(lambda number: rows[number : number + 1], lambda one: int(one.object_id))
    memory = units[:count]
    index.follow(memory)
    questions = [row[None] + rows[0] for row in rng.standard_normal((3, DIMENSION)) / 30]
    asked = [(q / np.linalg.norm(q)).astype(np.float32) for q in questions]

    def kept(number: int) -> None:
        index.follow(memory)
        index.best(asked[number % 3], K)

    def changed(number: int) -> None:
        memory[:] = [*memory[1:], units[count + number]]
        kept(number)

    def plain(number: int) -> None:
        scores = rows[:count] @ asked[number % 3][0]
        best = np.argpartition(-scores, min(K, count - 1))[:K]
        best[np.argsort(-scores[best], kind="stable")]

    return timed(plain_first(kept), repeats), timed(changed, repeats), timed(plain, repeats)


def plain_first(call: Callable[[int], None]) -> Callable[[int], None]:
    """Return a call that was made once before, so that what it sets up is there."""
    call(0)
    return call


def kinds(
    recall: Recall, count: int, repeats: int, new: Iterator[str]
) -> tuple[float, float, float]:
    """Time `stateful` over kinds: as it is, with a unit that changed, with phrases never read."""
    names = sorted(lexicon())
    units = [unit(number, names[number % len(names)]) for number in range(count + repeats)]
    memory = units[:count]
    for text in ASKED:
        recall.recall(text, memory, K)

    def asked(number: int) -> None:
        recall.recall(ASKED[number % 3], memory, K)

    def changed(number: int) -> None:
        memory[:] = [*memory[1:], units[count + number]]
        asked(number)

    def encoded(number: int) -> None:
        recall.recall(next(new), memory, K)

    return timed(asked, repeats), timed(changed, repeats), timed(encoded, repeats)


def fresh_phrases() -> Iterator[str]:
    """Yield phrases of seven words that nobody has asked yet."""
    for entry in lexicon().values():
        for name in entry.names:
            yield f"the old {name} of my aunt"


def unit(number: int, kind: str) -> MemoryUnit:
    """Return a unit with some state and place."""
    return MemoryUnit(
        object_id=str(number),
        object_type=kind,
        position_m=(0.0, 0.0, 0.0),
        states=STATES[number % len(STATES)],
        place_id=PLACES[number // 7 % len(PLACES)],
        handled=number % 3 == 0,
    )


def timed(call: Callable[[int], None], repeats: int) -> float:
    """Return the median milliseconds of some calls."""
    spent = []
    for number in range(repeats):
        begun = process_time()
        call(number)
        spent.append(process_time() - begun)
    return 1000 * median(spent)


if __name__ == "__main__":
    main()
