"""How many workers a run can use: by cores, free memory, models and the episodes that are left."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from karma.agent.loading.models import Models, Row
from karma.errors import UnknownNameError
from karma.infer.checks.memory import available_mb
from karma.infer.llama.devices import devices
from karma.infer.manifest.manifest import find_model

_BASE_MB = 350  # Python with torch, faiss and a world, beside the models; measured
_SHARE = 0.8  # of the free memory, for all workers together
_WORTH = 6  # episodes that make up for starting one worker more
IN_FLIGHT = 8  # requests that a server is asked at once where it does not say how many it takes
_WORTH_WAITING = 2  # episodes, likewise, where each waits for a server


@dataclass(frozen=True, slots=True, kw_only=True)
class Suggestion:
    """How many workers to use, and why."""

    number: int
    reason: str


def suggest_workers(
    models: Models, episodes: int, rows: Sequence[Row] = (), *, in_flight: int | None = None
) -> Suggestion:
    """Return as many workers as there are cores and memory for; few episodes need but one.

    Args:
        models: of the run.
        episodes: that are left to do.
        rows: of the run; some may name a vision model of their own.
        in_flight: requests that a hosted planner takes at once; workers that wait for it need no
            core each. None: nobody waits.
    """
    local = models.hosted.planner is None
    if local and models.gpu_layers != 0 and any(one.is_gpu for one in devices()):
        return Suggestion(number=1, reason="a GPU, which one process has for itself")
    if in_flight is not None:
        most, worth = in_flight, episodes // _WORTH_WAITING
        bound = f"{most} requests in flight"
    else:
        most = max(1, len(os.sched_getaffinity(0)) // max(1, models.threads))
        worth, bound = episodes // _WORTH, f"{most} cores"
    each, free = worker_mb(models, rows), available_mb()
    fitting = most if free is None else int(free * _SHARE // each)
    memory = "memory not known" if free is None else f"{free:.0f} MB free"
    reason = f"{bound}, {memory}, about {each:.0f} MB each, {episodes} episodes to do"
    return Suggestion(number=max(1, min(most, fitting, worth)), reason=reason)


def worker_mb(models: Models, rows: Sequence[Row] = ()) -> float:
    """Return about how much memory one worker takes, in MB."""
    seeing = sorted({models.vision, *(row.vision for row in rows)})
    named = [models.planner, models.embedder.partition(":")[2]]
    named += [name.partition(":")[2] for name in seeing]
    named += models.detector.partition(":")[2].split("+")
    named += ["minilm"] if models.embedder == "minilm" else []
    named += ["karma-nano-vlm"] if "nano-vlm" in seeing else []
    return _BASE_MB + sum(_model_mb(name) for name in named if name)


def _model_mb(name: str) -> float:
    path = Path(name)
    if path.is_file():
        return path.stat().st_size * 1.2 / 1e6 + 100
    try:
        return float(find_model(name).memory_mb or 0)
    except UnknownNameError:
        return 0.0
