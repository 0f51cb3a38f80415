"""Run chains in this process, in several, or on a cluster that a plug-in reaches."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from karma import registry
from karma.bench.engine.pool import ChainQueue, in_processes
from karma.bench.engine.suite import Chain, Do, Done, Suite
from karma.errors import KarmaError, UnknownNameError, UnwritableError
from karma.journal.records import NotRun
from karma.loading.models import Models, Row
from karma.models.checks.memory import available_mb
from karma.models.endpoint import Hosted
from karma.models.llama.opening import devices
from karma.models.manifest import find_model
from karma.models.session import Cassette, CassetteError, Session, Tape, open_cassette
from karma.offline.guard import NetworkRefused, go_offline, network_allowed

_BASE_MB = 350  # Python with torch, faiss and a world, beside the models; measured
_SHARE = 0.8  # of the free memory, for all workers together
_WORTH = 6  # episodes that make up for starting one worker more
IN_FLIGHT = 8  # requests that a server is asked at once
_WORTH_WAITING = 2  # episodes, likewise, where each waits for a server


def perform(
    suite: Suite,
    chains: Sequence[Chain],
    session: Session,
    *,
    workers: int = 1,
    ray: str = "",
    header: Any = None,
) -> Iterator[Done]:
    """Do chains of a suite, in any order; yields what each episode leaves, or why it was not run.

    `ray` is the address of a cluster's head, HOST:PORT; "" is this machine. On a cluster 0 workers
    are as many as it has cores and memory for, and the run's header is held against every node.

    Raises:
        KarmaError: see `in_processes` and `played`; or the plug-in for clusters is missing.
    """
    models = suite.models
    found: Iterator[Iterable[Done]]
    if ray:
        found = registry.load("clusters", "ray")(suite, chains, workers, ray, header)
    elif workers > 1:
        begin = partial(_begun, suite, session.cassette.tape, network_allowed())
        imports = (__name__, type(suite).__module__, *imported(models))
        found = in_processes(begin, chains, workers, imports)
    else:
        found = _here(suite, chains, session)
    for done in found:
        yield from done


def _here(suite: Suite, chains: Sequence[Chain], session: Session) -> Iterator[Iterable[Done]]:
    """Do chains in this process; each episode is yielded before the next is begun."""
    play, queue, chain = suite.begin(session), ChainQueue(chains), None
    while queue.chains:
        chain = queue.next_after(chain)
        yield played(play, chain, session)


def _begun(suite: Suite, tape: Tape, network: bool) -> Do:
    """Load what a worker process needs."""
    go_offline(allow_network=network)
    return loaded(suite, Session(open_cassette(tape)))


def loaded(suite: Suite, session: Session) -> Do:
    """Load what a worker needs that leaves each chain whole."""
    play = suite.begin(session)
    return lambda chain: list(played(play, chain, session))


def played(
    play: Callable[[Chain], Iterator[Done]], chain: Chain, session: Session
) -> Iterator[Done]:
    """Do a chain; what one episode of it leaves may be the next one's, so none follows a lost one.

    Raises:
        KarmaError: no other could be run either: the disk is full, a recording is of other
            requests, or somebody asked for the network.
    """
    episodes, problem = play(chain), ""
    for row, task, seed in chain.keys:
        try:
            one = next(episodes) if not problem else None
        except (UnwritableError, CassetteError, NetworkRefused):
            raise
        except KarmaError as error:
            problem, one = str(error), None
        session.ledger.take()
        yield NotRun(row=row, task=task, seed=seed, reason=problem) if one is None else one


def imported(models: Models) -> tuple[str, ...]:
    """Return what is imported once for all workers: what their models take, and no more."""
    hosted = models.hosted
    needed = {
        "llama_cpp": bool(models.planner) and hosted.planner is None,
        "sentence_transformers": models.embedder.partition(":")[0] == "sentence",
        "openai": hosted != Hosted(),
    }
    return tuple(name for name, wanted in needed.items() if wanted)


def check_far(models: Models, cassette: Cassette) -> None:
    """Raise KarmaError for what no other machine can do: keys and recordings do not travel."""
    if models.hosted != Hosted() or cassette.mode != "off":
        raise KarmaError(
            "hosted models and cassettes are for workers on this machine\n"
            "  To fix: --workers in place of --ray"
        )


# ----------------------------------------------------------------- how many


class Suggestion(NamedTuple):
    """How many workers to use, and why."""

    number: int
    reason: str


def suggest_workers(
    models: Models, episodes: int, rows: Sequence[Row] = (), *, in_flight: int | None = None
) -> Suggestion:
    """Return as many workers as there are cores and memory for; few episodes need but one.

    Rows may name a vision model of their own. `in_flight` are the requests that a hosted planner
    takes at once; workers that wait for it need no core each. None: nobody waits.
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
    named += ["minilm"] if models.embedder == "minilm" else []
    named += ["karma-nano-vlm"] if "nano-vlm" in seeing else []
    return _BASE_MB + sum(_model_mb(name) for name in named if name)


def _model_mb(name: str) -> float:
    path = Path(name)
    if path.is_file():
        return path.stat().st_size * 1.2 / 1e6 + 100
    return listed_mb(name) or 0.0


def listed_mb(name: str) -> float | None:
    """Return the memory that a model of the manifest takes; None where that is not known."""
    try:
        return find_model(name).memory_mb
    except UnknownNameError:
        return None
