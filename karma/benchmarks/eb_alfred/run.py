"""A run of EB-ALFRED in its folder: begun, gone on with, and finished.

The folder holds `header.json` (what the records depend on), `episodes.jsonl`, `timings.jsonl` and,
once it is finished, `results.json` and `table.md`. A killed run goes on where it was.
"""

import fcntl
import hashlib
import multiprocessing
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.bench.experiment import language_model
from karma.bench.experiment_tasks import beside
from karma.bench.provenance import model_hashes, versions
from karma.benchmarks.eb_alfred.experiment import (
    BenchmarkExperiment,
    BenchmarkRow,
    read_benchmark,
    tasks_of,
)
from karma.benchmarks.eb_alfred.play import BenchmarkRecord, BenchmarkStage, EpisodeKey, play
from karma.benchmarks.eb_alfred.table import results_of, written
from karma.benchmarks.eb_alfred.tasks import BenchmarkTask, read_rooms
from karma.errors import FileError, KarmaError
from karma.files import append_line, decode_json, read_bytes, read_json, to_json, write_atomic
from karma.infer.hosted.cassette import Cassette
from karma.infer.hosted.session import Hosted, Session
from karma.offline import go_offline
from karma.world.eb_alfred.actions import read_types

HEADER, EPISODES, TIMINGS, RESULTS, TABLE = (
    "header.json", "episodes.jsonl", "timings.jsonl", "results.json", "table.md",
)  # fmt: skip
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class BenchmarkHeader(msgspec.Struct, frozen=True, kw_only=True):
    """What a run's records depend on."""

    experiment: str  # SHA-256
    files: dict[str, str]  # of the benchmark and the prompt: name -> SHA-256
    versions: dict[str, str]
    models: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """Episodes that one process does in their order: in strict rows counts of puts go on."""

    row: BenchmarkRow
    tasks: tuple[BenchmarkTask, ...]
    seed: int

    @property
    def keys(self) -> tuple[EpisodeKey, ...]:
        """What names its episodes."""
        return tuple((self.row.name, task.id, self.seed) for task in self.tasks)


class _Timing(msgspec.Struct, frozen=True, kw_only=True):
    row: str
    task: str
    seed: int
    seconds: float


_Done = list[tuple[BenchmarkRecord, float]]  # with its seconds


class BenchmarkRun:
    """An experiment in its folder.

    Args:
        path: the TOML file.
        folder: of the run.
        fresh: throw away what an earlier run left there.
        cassette: records hosted models or stands for them.
        base_url: of hosted models, in place of the experiment's.
        computed: keys of its [models] that say how they are computed, in place of its own.

    Raises:
        FileError: a file is damaged, or the folder holds a run of something else.
        KarmaError: another run is at work in the folder.
    """

    def __init__(
        self,
        path: Path,
        folder: Path,
        *,
        fresh: bool = False,
        cassette: Cassette | None = None,
        base_url: str = "",
        computed: Mapping[str, Any] | None = None,
    ) -> None:
        self.path, self.folder = path, folder
        experiment = read_benchmark(path)
        self.experiment = msgspec.structs.replace(
            experiment, models=experiment.models.computed_by(computed or {})
        )
        self._models = self.experiment.models
        if base_url:  # where it is asked is no part of what a run depends on
            hosted = self._models.hosted.at(base_url)
            self._models = msgspec.structs.replace(self._models, hosted=hosted)
        self.tasks = tasks_of(self.experiment, path)
        self._session = Session(cassette)
        folder.mkdir(parents=True, exist_ok=True)
        with self._locked():
            if fresh:
                for name in (HEADER, EPISODES, TIMINGS, RESULTS, TABLE):
                    (folder / name).unlink(missing_ok=True)
            self._claim()
            self.records = self._read()

    @property
    def total(self) -> int:
        """How many episodes there are."""
        return sum(len(chain.tasks) for chain in self._chains())

    @property
    def alone(self) -> bool:
        """Whether one process has to do it all: a hosted model's session, or a cassette."""
        hosted = self.experiment.plans and self.experiment.models.hosted != Hosted()
        return hosted or self._session.cassette.mode != "off"

    def episodes(self, workers: int = 1) -> Iterator[BenchmarkRecord]:
        """Do what is missing; each record is on the disk before it is yielded.

        Records come in the order of seeds, rows and tasks, whatever the workers.

        Raises:
            KarmaError: a model cannot be loaded, or hosted models are to be asked by several
                processes.
        """
        if workers > 1 and self.alone:
            raise KarmaError("a hosted model is asked by one process only\n  To fix: --workers 1")
        with self._locked():
            self.records = self._read()
            done = {record.key for record in self.records}
            left = [chain for chain in self._chains() if not done.issuperset(chain.keys)]
            for found in self._perform(left, workers):
                for record, seconds in found:
                    timing = _Timing(
                        row=record.row, task=record.task, seed=record.seed, seconds=seconds
                    )
                    append_line(self.folder / TIMINGS, to_json(timing))
                    append_line(self.folder / EPISODES, to_json(record))
                    self.records.append(record)
                    yield record
            self._finish()

    # ------------------------------------------------------------- parts

    def _chains(self) -> list[Chain]:
        return [
            Chain(row=row, tasks=tasks, seed=seed)
            for seed in self.experiment.seeds
            for row in self.experiment.rows
            for tasks in (_by_subset(self.tasks) if row.strict else [(one,) for one in self.tasks])
        ]

    def _perform(self, chains: Sequence[Chain], workers: int) -> Iterator[_Done]:
        if not chains:
            return
        if workers <= 1:
            stage = _staged(self._asked(), self._session)
            for chain in chains:
                yield _played(stage, chain, self._session)
            return
        forking = multiprocessing.get_context("forkserver")
        before = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
        try:
            with ProcessPoolExecutor(
                workers, mp_context=forking, initializer=_begin_work, initargs=(self._asked(),)
            ) as pool:
                yield from pool.map(_work_on, chains)
        finally:
            for name, value in before.items():
                os.environ.pop(name)
                if value is not None:
                    os.environ[name] = value

    def _asked(self) -> BenchmarkExperiment:
        return msgspec.structs.replace(self.experiment, models=self._models)

    def _claim(self) -> None:
        """Make the folder this run's, or see that it is.

        Raises:
            FileError: it holds a run of something else.
        """
        place, header = self.folder / HEADER, _header(self.experiment)
        if place.exists() and read_json(place, BenchmarkHeader) != header:
            fix = f"--out another folder, or karma eval {self.path} --fresh"
            raise FileError(place, "this folder holds a run of something else", fix=fix)
        write_atomic(place, to_json(header, indent=2))

    def _read(self) -> list[BenchmarkRecord]:
        """Return the records of chains that are whole; lines of others are dropped."""
        place = self.folder / EPISODES
        lines = read_bytes(place).split(b"\n")[:-1] if place.exists() else []
        found = {r.key: r for r in (decode_json(one, BenchmarkRecord, path=place) for one in lines)}
        whole = [chain.keys for chain in self._chains() if found.keys() >= {*chain.keys}]
        records = [found[key] for keys in whole for key in keys]
        if lines:
            write_atomic(place, b"".join(map(to_json, records)))
        return records

    def _finish(self) -> None:
        order = [key for chain in self._chains() for key in chain.keys]
        found = {record.key: record for record in self.records}
        self.records = [found[key] for key in order]
        write_atomic(self.folder / EPISODES, b"".join(map(to_json, self.records)))
        published = beside(self.experiment.published) if self.experiment.published else None
        results = results_of(self.records)
        write_atomic(self.folder / RESULTS, to_json(results, indent=2))
        write_atomic(self.folder / TABLE, written(results, published).encode())

    @contextmanager
    def _locked(self) -> Iterator[None]:
        handle = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError as error:
            raise KarmaError(
                f"{self.folder}: another run is at work in this folder\n"
                "  To fix: wait for it, or --out another folder"
            ) from error
        finally:
            os.close(handle)


def _by_subset(tasks: Sequence[BenchmarkTask]) -> list[tuple[BenchmarkTask, ...]]:
    groups: dict[str, list[BenchmarkTask]] = {}
    for task in tasks:
        groups.setdefault(task.subset, []).append(task)
    return [tuple(group) for group in groups.values()]


def _header(experiment: BenchmarkExperiment) -> BenchmarkHeader:
    here = Path(__file__).parent
    files = [here / "prompt.toml", here / "examples.toml"]
    files += [beside(one) for one in (experiment.tasks, experiment.types, experiment.trials)]
    return BenchmarkHeader(
        experiment=hashlib.sha256(to_json(experiment)).hexdigest(),
        files={file.name: hashlib.sha256(read_bytes(file)).hexdigest() for file in files},
        versions=versions(),
        models=dict(model_hashes(experiment.models, ())) if experiment.plans else {},
    )


# ----------------------------------------------------------------- at work


def _staged(experiment: BenchmarkExperiment, session: Session) -> BenchmarkStage:
    model = None
    if experiment.plans:
        models = msgspec.structs.replace(experiment.models, constrained=False)  # plans, no programs
        model, _ = language_model(models, session, None, experiment.seeds[0])
    return BenchmarkStage(
        rooms=read_rooms(beside(experiment.trials)),
        types=read_types(beside(experiment.types)),
        model=model,
    )


def _played(stage: BenchmarkStage, chain: Chain, session: Session) -> _Done:
    puts: dict[str, int] = {}
    found = []
    for task in chain.tasks:
        session.cassette.begin("/".join(map(str, (chain.row.name, task.id, chain.seed))))
        begun = time.perf_counter()
        record = play(stage, chain.row, task, chain.seed, puts)
        session.ledger.take()
        found.append((record, time.perf_counter() - begun))
    return found


_stage: BenchmarkStage | None = None  # of a worker process


def _begin_work(experiment: BenchmarkExperiment) -> None:
    global _stage  # noqa: PLW0603  a worker's own
    go_offline()
    _stage = _staged(experiment, Session())


def _work_on(chain: Chain) -> _Done:
    if _stage is None:
        raise RuntimeError("a worker was not begun")
    return _played(_stage, chain, Session())
