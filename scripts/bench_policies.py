"""Throughput of every replacement policy: bare, in a short-term memory, and in the laboratory.

python scripts/bench_policies.py [--requests N] [--lines N]

One Zipf(1) trace over 1,000 objects, best of a few runs each, million requests per second of this
process's own time, so that other work on the machine counts less:

- touch: the policy's own `touch`, one call a request; beside it the share of an OrderedDict LRU.
- memory: `ShortTermMemory.find` and `remember`, one request after another, as a caller of the
  public interface would do it; on the first tenth of the trace.
- lab: `karma.lab.simulate` over the same trace, with hits per request, and how many times
  faster that is than the memory. It must hit as often as the memory, or the run fails.
"""

import argparse
from collections import OrderedDict
from collections.abc import Callable
from time import process_time

from karma import registry
from karma.contracts import MemoryUnit
from karma.lab.simulate import simulate
from karma.lab.trace import Trace
from karma.memory.policies import make_policy
from karma.memory.short_term import ShortTermMemory
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


def run_memory(text: str, trace: list[str]) -> int:
    """Ask a memory for every object of the trace and remember it; return the hits."""
    memory = ShortTermMemory(make_policy(text))
    hits = 0
    for key in trace:
        hits += key in memory
        memory.remember(MemoryUnit(object_id=key, object_type="Object", position_m=(0.0, 0.0, 0.0)))
    return hits


def best_mops(run: Callable[[], object], requests: int) -> float:
    """Return million requests per second, the best of a few runs."""
    times = []
    for _ in range(REPEATS):
        start = process_time()
        run()
        times.append(process_time() - start)
    return requests / min(times) / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--lines", type=int, default=10)
    options = parser.parse_args()
    weights = 1 / stream(0, "bench", "order").permutation(range(1, KINDS + 1))  # Zipf(1)
    drawn = stream(0, "bench").choice(KINDS, size=options.requests, p=weights / weights.sum())
    trace = [f"Object|{number}" for number in drawn]
    part = trace[: max(1, len(trace) // 10)]
    numbered = Trace.of((key,) for key in trace)
    beginning = Trace.of((key,) for key in part)
    yardstick = best_mops(lambda: bare_lru(trace, options.lines), len(trace))
    print(f"{'policy':<28}{'touch':>8}{'ratio':>8}{'memory':>8}{'lab':>8}{'ratio':>8}")
    print(f"{'OrderedDict LRU (yardstick)':<28}{yardstick:>8.3f}{1:>8.2f}")
    texts = [f"{name}[{options.lines}]" for name in registry.names("policies")]
    texts += [f"{text} cm4" for text in texts if text.startswith("wtinylfu")]
    slowest = float("inf")
    for text in texts:
        touch = best_mops(lambda text=text: run_policy(text, trace), len(trace))  # type: ignore[misc]
        memory = best_mops(lambda text=text: run_memory(text, part), len(part))  # type: ignore[misc]
        lab = best_mops(lambda text=text: simulate(text, numbered), len(trace))  # type: ignore[misc]
        if run_memory(text, part) != simulate(text, beginning).hits:
            raise SystemExit(f"{text}: the laboratory and the memory count differently")
        slowest = min(slowest, lab / memory)
        print(
            f"{text:<28}{touch:>8.3f}{touch / yardstick:>8.2f}{memory:>8.3f}{lab:>8.3f}"
            f"{lab / memory:>8.1f}"
        )
    print(f"the laboratory is at least {slowest:.1f} times as fast as the memory, one by one")


if __name__ == "__main__":
    go_offline()
    main()
