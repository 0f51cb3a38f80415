"""Throughput of every replacement policy against an OrderedDict LRU, in the same run.

python scripts/bench_policies.py [--requests N] [--lines N]
"""

import argparse
from collections import OrderedDict
from collections.abc import Callable
from time import perf_counter

from karma import registry
from karma.memory.policies import make_policy
from karma.offline import go_offline
from karma.seeds import stream

KINDS = 1000
REPEATS = 3


def bare_lru(trace: list[str], lines: int) -> None:
    """Run the yardstick: get or put, nothing else."""
    order: OrderedDict[str, None] = OrderedDict()
    for key in trace:
        if key in order:
            order.move_to_end(key)
        else:
            order[key] = None
            if len(order) > lines:
                order.popitem(last=False)


def run_policy(text: str, trace: list[str]) -> None:
    """Touch every key of the trace."""
    touch = make_policy(text).touch
    for key in trace:
        touch(key)


def best_mops(run: Callable[[], None], requests: int) -> float:
    """Return million requests per second, the best of a few runs."""
    times = []
    for _ in range(REPEATS):
        start = perf_counter()
        run()
        times.append(perf_counter() - start)
    return requests / min(times) / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--lines", type=int, default=10)
    options = parser.parse_args()
    weights = 1 / stream(0, "bench", "order").permutation(range(1, KINDS + 1))  # Zipf(1)
    drawn = stream(0, "bench").choice(KINDS, size=options.requests, p=weights / weights.sum())
    trace = [f"Object|{number}" for number in drawn]
    yardstick = best_mops(lambda: bare_lru(trace, options.lines), len(trace))
    print(f"{'policy':<28}{'Mops/s':>8}{'ratio':>8}")
    print(f"{'OrderedDict LRU (yardstick)':<28}{yardstick:>8.3f}{1:>8.2f}")
    texts = [f"{name}[{options.lines}]" for name in registry.names("policies")]
    texts += [f"{text} cm4" for text in texts if text.startswith("wtinylfu")]
    for text in texts:
        mops = best_mops(lambda text=text: run_policy(text, trace), len(trace))  # type: ignore[misc]
        print(f"{text:<28}{mops:>8.3f}{mops / yardstick:>8.2f}")


if __name__ == "__main__":
    go_offline()
    main()
