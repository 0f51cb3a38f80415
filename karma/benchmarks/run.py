"""A run of any benchmark in its folder: begun, gone on with, and finished.

The folder holds `header.json` (what the records depend on), `episodes.jsonl`, `timings.jsonl` and,
once it is finished, `results.json` and `table.md`. A killed run goes on where it was.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from karma.bench.experiment_file import Changes, read_as
from karma.bench.sheet import to_markdown
from karma.bench.worker_count import IN_FLIGHT, Suggestion, suggest_workers
from karma.bench.workers import check_workers
from karma.benchmarks.benchmark import (
    Benchmark,
    BenchmarkResults,
    Chain,
    ExperimentFile,
    PlayedEpisode,
)
from karma.benchmarks.header import BenchmarkHeader, differences, header_of, kind_of, read_header
from karma.benchmarks.workers import ChainPlayer, loaded_models
from karma.errors import FileError, KarmaError
from karma.files import append_line, read_bytes, read_toml, to_json
from karma.infer.hosted.cassette import Cassette
from karma.infer.hosted.server import slots_of
from karma.infer.hosted.session import Session
from karma.journal.folder import locked, read_lines, refuse_other
from karma.journal.not_run import FILE as NOT_RUN
from karma.journal.not_run import IN_A_ROW, NotRun, in_words, read_not_run
from karma.journal.owned_folder import HEADER, MARK, OwnedFolder, check_sealed
from karma.journal.records import Key
from karma.journal.run_folder import EPISODES, RESULTS, TIMINGS, benchmark_in

TABLE = "table.md"
_OURS = (HEADER, EPISODES, TIMINGS, RESULTS, TABLE, NOT_RUN)


class _Benchmarked(msgspec.Struct, frozen=True):
    benchmark: str = ""


class _Timing(msgspec.Struct, frozen=True, kw_only=True):
    row: str
    task: str
    seed: int
    seconds: float


def is_benchmark(path: Path) -> bool:
    """Return whether a file is an experiment of a benchmark; False where it cannot be read."""
    try:
        return bool(read_toml(path, _Benchmarked).benchmark)
    except FileError:
        return False


class BenchmarkRun:
    """An experiment in its folder.

    Args:
        path: the TOML file.
        folder: of the run.
        fresh: throw away what an earlier run left there.
        cassette: records hosted models or stands for them.
        base_url: of hosted models, in place of the experiment's.
        computed: keys of its [models] that say how they are computed, in place of its own.
        changes: what it says otherwise than its file.

    Raises:
        FileError: a file is damaged, a key in it is unknown, or the folder holds a run of
            something else.
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
        changes: Changes | None = None,
    ) -> None:
        self.path, self.folder = path, folder
        self._kind = kind_of(read_toml(path, _Benchmarked).benchmark, path)
        read = read_as(path, self._kind.experiment_kind, changes)
        said = read.models.computed_by(computed or {})
        self.experiment: ExperimentFile = msgspec.structs.replace(read, models=said)
        models = said
        if base_url:  # where it is asked is no part of what a run depends on
            models = msgspec.structs.replace(said, hosted=said.hosted.at(base_url))
        self._asked = msgspec.structs.replace(read, models=models)
        self.benchmark: Benchmark = self._kind(self._asked, path)
        self.chains = tuple(self.benchmark.chains())
        self._session = Session(cassette)
        self._player = ChainPlayer(
            benchmark=self.benchmark, experiment=self._asked, path=path, session=self._session
        )
        with locked(folder):
            self._owned = OwnedFolder(folder, "benchmark")
            if fresh and self._owned.look():
                self._owned.clear()
            self._claim()
            self.records = self._read()
        self.not_run: list[NotRun] = []  # of those that were tried last

    @property
    def total(self) -> int:
        """How many episodes there are."""
        return sum(len(chain.tasks) for chain in self.chains)

    @property
    def left(self) -> int:
        """How many of them are not done yet."""
        return self.total - len(self.records)

    def results(self) -> BenchmarkResults:
        """Return what the records so far come to; errors as `Benchmark.results`."""
        return _with(self.benchmark.results(self.records), self.not_run)

    def suggest(self) -> Suggestion:
        """Return how many workers to use unless a number is given.

        Raises:
            KarmaError: a hosted planner may not or cannot be reached.
        """
        models = self._asked.models
        if not self.experiment.plans:  # no model is loaded
            return suggest_workers(loaded_models(self.experiment), self.left)
        in_flight = None
        if models.hosted.planner is not None and self._session.cassette.mode != "replay":
            in_flight = slots_of(models.hosted.planner) or IN_FLIGHT
        return suggest_workers(models, self.left, in_flight=in_flight)

    def episodes(self, workers: int = 1, *, ray: str = "") -> Iterator[PlayedEpisode]:
        """Do what is missing; each record is on the disk before it is yielded.

        When the last is done, all lines are put in the order of the chains, in whatever order
        they were done. What was not run is in `not_run` afterwards; then the run is not finished.

        Args:
            workers: processes to use, each with models of its own.
            ray: address of a Ray cluster, whose machines play; then 0 workers are as many as it
                has room for.

        Raises:
            KarmaError: a model cannot be loaded or a hosted one not reached, a cluster is to ask
                hosted models, another run is at work in the folder, or several episodes in a row
                were not run.
        """
        if workers > 1 or ray:
            check_workers(self._asked.models, self._session.cassette, ray)
        with locked(self.folder):
            self._claim()
            self.records = self._read()
            done = {_key(record) for record in self.records}
            left = [chain for chain in self.chains if not done.issuperset(chain.keys)]
            if left:
                self._reopen()
            in_a_row = 0
            for record, seconds in self._perform(left, workers, ray):
                if isinstance(record, NotRun):
                    in_a_row += not record.alone
                    self._put_aside(record, ends=in_a_row == IN_A_ROW)
                    continue
                in_a_row = 0
                row, task, seed = _key(record)
                timing = _Timing(row=row, task=task, seed=seed, seconds=seconds)
                append_line(self.folder / TIMINGS, to_json(timing))
                append_line(self.folder / EPISODES, to_json(record))
                self.records.append(record)
                yield record
            if not self.not_run:
                self._finish()

    # ------------------------------------------------------------- parts

    def _reopen(self) -> None:
        """Take back what says how an earlier command ended."""
        self.not_run = []
        for name in (RESULTS, TABLE, NOT_RUN):
            (self.folder / name).unlink(missing_ok=True)

    def _put_aside(self, one: NotRun, *, ends: bool) -> None:
        """Keep why an episode was not run; `ends`: so many were not that none would be."""
        self.not_run.append(one)
        append_line(self.folder / NOT_RUN, to_json(one))
        if ends:
            raise KarmaError(f"{IN_A_ROW} episodes one after the other were not run: {one.reason}")

    def _perform(
        self, chains: Sequence[Chain], workers: int, ray: str
    ) -> Iterator[tuple[Any, float]]:
        """Play chains; yield records with their seconds."""
        if not chains:
            return iter(())
        if ray:
            return self._player.on_ray(chains, ray, workers, self._header)
        if workers > 1:
            return self._player.in_processes(chains, workers)
        return self._player.here(chains)

    def _claim(self) -> None:
        """Make the folder this run's, or see that it is.

        Raises:
            FileError: it holds a run of something else.
        """
        self._header = header_of(self.experiment, self.benchmark)
        place, header = self.folder / HEADER, self._header
        if not (self.folder / MARK).exists() and benchmark_in(self.folder):  # an earlier version's
            found = differences(read_header(self.folder), header)
            refuse_other(place, found, fix="--out another folder")
            self._owned.adopt(_OURS, read_bytes(place))
        self._owned.look()
        check_sealed(self.folder)
        if place.exists():
            fix = f"--out another folder, or karma eval {self.path} --fresh"
            refuse_other(place, differences(read_header(self.folder), header), fix=fix)
        else:
            data = to_json(header, indent=2)
            self._owned.begin(_OURS, data)
            self._owned.write(HEADER, data)

    def _read(self) -> list[Any]:
        """Return the records of chains that are whole; lines of others are dropped."""
        self._owned.sweep()
        place = self.folder / EPISODES
        found = {_key(one): one for one in read_lines(place, self._kind.record_kind)}
        whole = [chain.keys for chain in self.chains if found.keys() >= {*chain.keys}]
        records = [found[key] for keys in whole for key in keys]
        if len(records) < len(found):
            (self.folder / RESULTS).unlink(missing_ok=True)  # it is not finished any more
        if place.exists():
            self._owned.write(EPISODES, b"".join(map(to_json, records)))
        return records

    def _finish(self) -> None:
        found = {_key(record): record for record in self.records}
        self.records = [found[key] for chain in self.chains for key in chain.keys]
        self._owned.write(EPISODES, b"".join(map(to_json, self.records)))
        results = self.results()
        self._owned.settle(seal=EPISODES, by=RESULTS)
        self._owned.write(RESULTS, to_json(results.figures, indent=2))
        self._owned.write(TABLE, written(results))


def read_results(folder: Path, *more: Path) -> BenchmarkResults:
    """Return what the records of one or more runs come to, finished or not.

    Args:
        folder: of a run.
        more: of other runs of the same tasks, with rows of their own.

    Raises:
        FileError: a folder holds no run of a benchmark, or a damaged line; or runs that are to
            stand in one table have other tasks, or a row of the same name.
    """
    headers = [read_header(one) for one in (folder, *more)]
    records: list[Any] = []
    remarks: list[str] = []
    for place, header in zip((folder, *more), headers, strict=True):
        kind, mine = read_records(place, header)
        rows = {one.row for one in records} & {one.row for one in mine}
        if header.files != headers[0].files:
            raise FileError(place / HEADER, f"its tasks or prompts are not those of {folder}")
        if rows:
            raise FileError(place / HEADER, f"row {min(rows)!r} is in another of these runs, too")
        records += mine
        remarks += _with(kind.results(mine), read_not_run(place)).remarks
    return replace(read_records(folder, headers[0])[0].results(records), remarks=tuple(remarks))


def _with(results: BenchmarkResults, not_run: Sequence[NotRun]) -> BenchmarkResults:
    """Return results that say what was not run."""
    said = in_words(not_run)
    return replace(results, remarks=(*results.remarks, *filter(None, [said])))


def read_records(folder: Path, header: BenchmarkHeader) -> tuple[Benchmark, list[Any]]:
    """Return a run's benchmark, and its records; FileError for a damaged line or a changed file."""
    check_sealed(folder)
    kind = kind_of(header.benchmark, folder / HEADER)
    try:
        experiment = msgspec.convert(header.experiment, kind.experiment_kind)
    except msgspec.ValidationError as error:
        fix = f"karma eval FILE --out {folder} --fresh"
        raise FileError(folder / HEADER, f"experiment: {error}", fix=fix) from error
    return kind(experiment, folder / HEADER), read_lines(folder / EPISODES, kind.record_kind)


def written(results: BenchmarkResults) -> bytes:
    """Return the tables as Markdown."""
    caption = " ".join((results.table.caption, *results.remarks))
    return to_markdown([replace(results.table, caption=caption), *results.behind]).encode()


def _key(record: PlayedEpisode) -> Key:
    return record.row, record.task, record.seed
