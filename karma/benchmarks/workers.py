"""Playing chains: in the run's process, in several, or on the machines of a Ray cluster.

A chain depends on its row, tasks and seed only, never on who plays it or on earlier ones.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from karma.bench.experiment_file import DataFolders, with_places_here
from karma.bench.pool import JobQueue, Workshop, in_processes
from karma.bench.ray_pool import in_cluster
from karma.bench.ray_workers import hashes_here, models_here, need_of, refuse_node
from karma.bench.workers import imported
from karma.benchmarks.benchmark import Benchmark, Chain, ExperimentFile, Play
from karma.benchmarks.header import BenchmarkHeader, differences, file_hashes, kind_of
from karma.errors import KarmaError, UnwritableError
from karma.infer.hosted.cassette import Cassette, CassetteError, Tape
from karma.infer.hosted.session import Session
from karma.journal.not_run import NotRun
from karma.journal.provenance import versions
from karma.loading.models import Models
from karma.offline import NetworkRefused, go_offline, network_allowed

_NO_MODELS = Models(planner="", embedder="", gpu_layers=0)
_Records = list[tuple[Any, float]]  # of a chain, each with the seconds that it took


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainPlayer:
    """Plays the chains of a run.

    Args:
        benchmark: made from the experiment.
        experiment: what it says, and where hosted models are asked.
        path: that it was read from.
        session: of hosted models.
    """

    benchmark: Benchmark
    experiment: ExperimentFile
    path: Path
    session: Session

    def here(self, chains: Sequence[Chain]) -> Iterator[tuple[Any, float]]:
        """Play in this process; yields each record as it is there."""
        play = self.benchmark.begin(self.session)
        queue, chain = JobQueue(chains), None
        while queue.jobs:
            chain = queue.next_after(chain)
            yield from _played(play, chain, self.session)

    def in_processes(self, chains: Sequence[Chain], number: int) -> Iterator[tuple[Any, float]]:
        """Play in `number` processes; yields the records of each chain as it is done."""
        plans, tape = self.experiment.plans, self.session.cassette.tape
        shop: Workshop[Chain, _Records] = Workshop(
            begin=partial(_begun, self.experiment, self.path, tape, network_allowed()),
            imports=(__name__, *(imported(self.experiment.models) if plans else ())),
        )
        for found in in_processes(shop, chains, number):
            yield from found

    def on_ray(
        self, chains: Sequence[Chain], address: str, number: int, header: BenchmarkHeader
    ) -> Iterator[tuple[Any, float]]:
        """Play on a cluster, see `in_cluster`; `header` is held against every node."""
        begin = partial(_begun_on_node, header, self.path, DataFolders.here())
        shop: Workshop[Chain, _Records] = Workshop(begin=begin)
        need = need_of(loaded_models(self.experiment))
        for found in in_cluster(shop, chains, address, need=need, number=number):
            yield from found


def loaded_models(experiment: ExperimentFile) -> Models:
    """Return the models that a worker loads: where no row plans, next to none."""
    return experiment.models if experiment.plans else _NO_MODELS


def _begun(experiment: Any, path: Path, tape: Tape, network: bool) -> Callable[[Chain], _Records]:
    """Load what a worker process needs."""
    go_offline(allow_network=network)
    benchmark: Benchmark = kind_of(experiment.benchmark, path)(experiment, path)
    return _player(benchmark, Session(Cassette.of(tape)))


def _begun_on_node(
    header: BenchmarkHeader, path: Path, there: DataFolders
) -> Callable[[Chain], _Records]:
    """Find this node's files and models, check that they are the run's, and load them.

    Args:
        header: of the run; says the whole experiment.
        path: that it was read from, on another machine.
        there: that machine's folders of data.
    """
    kind = kind_of(header.benchmark, path)
    experiment = with_places_here(msgspec.convert(header.experiment, kind.experiment_kind), there)
    if experiment.plans:
        models = models_here(experiment.models, header.models)
        experiment = msgspec.structs.replace(experiment, models=models)
    benchmark: Benchmark = kind(experiment, path)
    mine = msgspec.structs.replace(
        header,
        files=file_hashes(benchmark),
        versions=versions(),
        models=hashes_here(models, header.models) if experiment.plans else {},
    )
    refuse_node(differences(header, mine))
    return _player(benchmark, Session())


def _player(benchmark: Benchmark, session: Session) -> Callable[[Chain], _Records]:
    play = benchmark.begin(session)
    return lambda chain: list(_played(play, chain, session))


def _played(play: Play, chain: Chain, session: Session) -> Iterator[tuple[Any, float]]:
    """Play a chain; yield records with their seconds, or why an episode was not run.

    Raises:
        KarmaError: no other could be run either, see `karma.bench.workers.Performer.do`.
    """
    records, problem = play(chain), ""
    for row, task, seed in chain.keys:
        session.cassette.begin(f"{row}/{task}/{seed}")
        begun = time.perf_counter()
        try:
            record = next(records) if not problem else None
        except (UnwritableError, CassetteError, NetworkRefused):
            raise
        except KarmaError as error:
            problem, record = str(error), None
        session.ledger.take()
        if record is None:  # what one leaves in a chain may be the next one's
            record = NotRun(row=row, task=task, seed=seed, reason=problem)
        yield record, time.perf_counter() - begun
