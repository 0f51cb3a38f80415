"""Million requests per second of every replacement policy, against an OrderedDict LRU.

python scripts/bench_policies.py [--requests N] [--lines N]

One Zipf(1) trace over 1,000 objects, best of three, seconds of the processor:

- touch: the policy's own `touch`, one call a request; its ratio is to the LRU.
- memory: `ShortTermMemory.find` and `remember`, one request after another, as a caller of the
  public interface would do it; on the first tenth of the trace.
- simulator: `karma.bench.policies.simulate` over the same trace; its ratio is to the memory.
  It must hit as often as the memory, or the run fails.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import typer
from measuring import table, taken

from karma import registry
from karma.bench.policies.simulate import Trace, simulate
from karma.memory.policies import make_policy
from karma.memory.short_term import ShortTermMemory
from karma.offline.guard import go_offline
from karma.seeds import stream
from karma.types.memory import MemoryUnit

KINDS = 1000


def bare_lru(trace: Sequence[str], lines: int) -> None:
    """Run the reference: get or put, nothing else."""
    order: OrderedDict[str, None] = OrderedDict()
    for key in trace:
        if key in order:
            order.move_to_end(key)
        else:
            order[key] = None
            if len(order) > lines:
                order.popitem(last=False)


def run_policy(text: str, trace: Sequence[str]) -> None:
    """Touch every key of the trace."""
    touch = make_policy(text).touch
    for key in trace:
        touch(key)


def run_memory(text: str, trace: Sequence[str]) -> int:
    """Ask a memory for every object of the trace and remember it; return the hits."""
    memory = ShortTermMemory(make_policy(text))
    hits = 0
    for key in trace:
        hits += key in memory
        memory.remember(MemoryUnit(object_id=key, object_type="Object", position_m=(0.0, 0.0, 0.0)))
    return hits


def mops(run: Callable[[], object], requests: int) -> float:
    """Return million requests per second, the best of three runs."""
    return requests / min(taken(run) for _ in range(3)) / 1e6


def main(requests: int = 100_000, lines: int = 10) -> None:
    """Print the table."""
    go_offline()
    weights = 1 / stream(0, "bench", "order").permutation(range(1, KINDS + 1))  # Zipf(1)
    drawn = stream(0, "bench").choice(KINDS, size=requests, p=weights / weights.sum())
    trace = [f"Object|{number}" for number in drawn]
    part = trace[: max(1, requests // 10)]
    numbered, beginning = (Trace.of((key,) for key in keys) for keys in (trace, part))

    def rows() -> Iterator[Sequence[object]]:
        lru = mops(partial(bare_lru, trace, lines), requests)
        yield "OrderedDict LRU", lru, 1.0, None, None, None
        texts = [f"{name}[{lines}]" for name in registry.names("policies")]
        for text in [*texts, *(f"{text} cm4" for text in texts if text.startswith("wtinylfu"))]:
            touch = mops(partial(run_policy, text, trace), requests)
            memory = mops(partial(run_memory, text, part), len(part))
            lab = mops(partial(simulate, text, numbered), requests)
            if run_memory(text, part) != simulate(text, beginning).hits:
                raise SystemExit(f"{text}: the laboratory and the memory count differently")
            yield text, touch, touch / lru, memory, lab, lab / memory

    table("policy | touch | of the LRU | memory | lab | of the memory", rows())


if __name__ == "__main__":
    typer.run(main)
