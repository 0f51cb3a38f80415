"""Doing chains: in this process, in several, or on the machines of a Ray cluster that is there.

On a cluster every node has this package and its own models, which are found by their SHA-256. A
node that has another model, version, prompt or file than the run says so by name, and the run ends.
What an episode leaves comes back with its record, so the run's folder lies on one machine only.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from karma.agent.journal.not_run import NotRun
from karma.agent.loading.models import Models
from karma.bench.engine.experiment_file import DataFolders
from karma.bench.engine.pool import JobQueue, Workshop, in_processes
from karma.bench.engine.ray_pool import WorkerNeed, in_cluster
from karma.bench.engine.suite import Chain, Do, Done, Suite
from karma.bench.engine.worker_count import worker_mb
from karma.errors import KarmaError, UnwritableError
from karma.infer.hosted.cassette import Cassette, CassetteError, Tape
from karma.infer.hosted.session import Hosted, Session
from karma.offline.guard import NetworkRefused, go_offline, network_allowed


def perform(
    suite: Suite,
    chains: Sequence[Chain],
    session: Session,
    *,
    workers: int = 1,
    ray: str = "",
    header: Any = None,
) -> Iterator[Done]:
    """Do chains; yields what each episode leaves, or why it was not run.

    Args:
        suite: that they are of.
        chains: in any order.
        session: of hosted models.
        workers: processes; on a cluster 0 for as many as it has cores and memory for.
        ray: address of the cluster's head, HOST:PORT; "" = this machine.
        header: what the run depends on, held against every node.

    Raises:
        KarmaError: see `in_processes`, `in_cluster` and `played`.
    """
    models = suite.models
    if ray:
        far: Workshop[Chain, Sequence[Done]] = Workshop(
            begin=partial(suite.begin_on_node, header, DataFolders.here())
        )
        cores, memory_mb = max(1, models.threads), worker_mb(models, suite.rows)
        need = WorkerNeed(cores=cores, memory_mb=memory_mb)
        for found in in_cluster(far, chains, ray, need=need, number=workers):
            yield from found
    elif workers > 1:
        near: Workshop[Chain, Sequence[Done]] = Workshop(
            begin=partial(_begun, suite, session.cassette.tape, network_allowed()),
            imports=(__name__, type(suite).__module__, *imported(models)),
        )
        for found in in_processes(near, chains, workers):
            yield from found
    else:
        play, queue, chain = suite.begin(session), JobQueue(chains), None
        while queue.jobs:
            chain = queue.next_after(chain)
            yield from played(play, chain, session)


def _begun(suite: Suite, tape: Tape, network: bool) -> Do:
    """Load what a worker process needs."""
    go_offline(allow_network=network)
    return loaded(suite, Session(Cassette.of(tape)))


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
