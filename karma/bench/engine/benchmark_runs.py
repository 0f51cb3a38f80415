"""Benchmarks by their own protocol as a run does them, and what their records come to."""

import hashlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from karma import registry
from karma.bench.engine.experiment_file import Changes, read_as
from karma.bench.engine.suite import (
    NO_MODELS,
    Benchmark,
    BenchmarkResults,
    Chain,
    Done,
    ExperimentFile,
)
from karma.bench.figures.tables import to_markdown
from karma.errors import FileError, UnknownNameError
from karma.files import read_bytes, read_toml, to_json
from karma.journal.folder import EPISODES, HEADER, RESULTS, SIGN, TABLE, check_sealed, read_lines
from karma.journal.header import Header
from karma.journal.provenance import model_hashes, versions
from karma.journal.records import NotRun, PlayedTiming, in_words, read_not_run
from karma.journal.run_folder import Finished, RunFolder
from karma.loading.models import Row
from karma.models.session import Session
from karma.offline.guard import network_allowed


class _Benchmarked(msgspec.Struct, frozen=True):
    benchmark: str


class BenchmarkSuite:
    """An experiment of a benchmark, see `Suite`; it is made anew in each process.

    The experiment is as its file and the command say it; `asked` is the same, with hosted models
    where the command has them asked. `path` is that of the file.
    """

    rows: tuple[Row, ...] = ()  # with models of their own: there are none

    def __init__(self, experiment: ExperimentFile, asked: ExperimentFile, path: Path) -> None:
        self.experiment, self._asked, self.path = experiment, asked, path
        self._kind = benchmark_of(experiment.benchmark, path)
        self.models = asked.models if asked.plans else NO_MODELS

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel as what it is made of."""
        return BenchmarkSuite, (self.experiment, self._asked, self.path)

    @cached_property
    def benchmark(self) -> Benchmark:
        """What plays, made from the experiment."""
        made: Benchmark = self._kind(self._asked, self.path)
        return made

    @property
    def header(self) -> Header:
        """What records depend on.

        Raises:
            FileError: a file that records depend on is missing.
            ModelError: a model's file is missing.
            UnknownNameError: there is no such model.
        """
        one = self.experiment
        return Header(
            kind="benchmark",
            name=one.name,
            options=msgspec.to_builtins(one),
            files=self.file_hashes(),
            versions=versions(),
            models=model_hashes(one.models) if one.plans else {},
            network=network_allowed(),
        )

    def file_hashes(self) -> dict[str, str]:
        """Return the hash of each file that records depend on; FileError for one lost."""
        files = self.benchmark.files()
        return {file.name: hashlib.sha256(read_bytes(file)).hexdigest() for file in files}

    def files(self, folder: Path) -> RunFolder:
        """Return the folder as what takes what episodes leave."""
        kind = self._kind.record_kind
        return RunFolder(folder, steps=False, records=kind)

    def chains(self, seeds: Sequence[int]) -> Sequence[Chain]:
        """Return all episodes in their final order; their seeds are the experiment's."""
        return self.benchmark.chains()

    def results(self, records: Sequence[Any], not_run: Sequence[NotRun] = ()) -> BenchmarkResults:
        """Return what records come to, finished or not; errors as `Benchmark.results`."""
        return _with(self.benchmark.results(records), not_run)

    def added_up(self, records: Sequence[Any]) -> dict[str, bytes]:
        """Return what records come to, by the names of its files."""
        results = self.results(records)
        return {RESULTS: to_json(results.figures, indent=2), TABLE: written(results)}

    def begin(self, session: Session) -> Callable[[Chain], Iterator[Done]]:
        """Load what episodes need; errors as `Benchmark.begin`."""
        play = self.benchmark.begin(session)

        def timed(chain: Chain) -> Iterator[Done]:
            records = play(chain)
            for row, task, seed in chain.keys:
                session.cassette.begin(f"{row}/{task}/{seed}")
                begun = time.perf_counter()
                one = next(records)
                taken = time.perf_counter() - begun
                timing = PlayedTiming(row=row, task=task, seed=seed, seconds=taken)
                yield one if isinstance(one, NotRun) else Finished(record=one, timing=timing)

        return timed


def benchmark_suite(
    path: Path, changes: Changes | None, computed: Mapping[str, Any], base_url: str
) -> BenchmarkSuite:
    """Read an experiment of a benchmark; arguments and errors as of `Run`."""
    kind = benchmark_of(read_toml(path, _Benchmarked).benchmark, path)
    read = read_as(path, kind.experiment_kind, changes)
    said = read.models.computed_by(computed)
    asked = said
    if base_url:  # where it is asked is no part of what a run depends on
        asked = msgspec.structs.replace(said, hosted=said.hosted.at(base_url))
    one, other = (msgspec.structs.replace(read, models=models) for models in (said, asked))
    return BenchmarkSuite(one, other, path)


def benchmark_of(name: str, path: Path) -> Any:
    """Return the class of a benchmark.

    Raises:
        FileError: there is no such benchmark; `path` names it.
    """
    try:
        return registry.load("benchmarks", name)
    except UnknownNameError as error:
        raise FileError(path, f"benchmark: {error}") from error


# ----------------------------------------------------------------- reading


def read_results(folder: Path, *more: Path) -> BenchmarkResults:
    """Return what the records of one or more runs come to, finished or not.

    `more` are folders of other runs of the same tasks, with rows of their own.

    Raises:
        FileError: a folder holds no run of a benchmark, or a damaged line; or runs that are to
            stand in one table have other tasks, or a row of the same name.
    """
    headers = [Header.read(one) for one in (folder, *more)]
    records: list[Any] = []
    remarks: list[str] = []
    for place, header in zip((folder, *more), headers, strict=True):
        kind, mine = read_played(place, header)
        rows = {one.row for one in records} & {one.row for one in mine}
        if header.files != headers[0].files:
            raise FileError(place / HEADER, f"its tasks or prompts are not those of {folder}")
        if rows:
            raise FileError(place / HEADER, f"row {min(rows)!r} is in another of these runs, too")
        records += mine
        remarks += _with(kind.results(mine), read_not_run(place)).remarks
    return replace(read_played(folder, headers[0])[0].results(records), remarks=tuple(remarks))


def _with(results: BenchmarkResults, not_run: Sequence[NotRun]) -> BenchmarkResults:
    """Return results that say what was not run."""
    said = in_words(not_run)
    return replace(results, remarks=(*results.remarks, *filter(None, [said])))


def read_played(folder: Path, header: Header) -> tuple[Benchmark, list[Any]]:
    """Return a run's benchmark, and its records; FileError for a damaged line or a changed file."""
    check_sealed(folder)
    if header.kind != "benchmark":
        raise FileError(folder, "no run of a benchmark", fix=f"karma report {folder}")
    kind = benchmark_of(header.options["benchmark"], folder / HEADER)
    try:
        experiment = msgspec.convert(header.options, kind.experiment_kind)
    except msgspec.ValidationError as error:
        fix = f"karma eval FILE --out {folder} --fresh"
        raise FileError(folder / HEADER, f"experiment: {error}", fix=fix) from error
    return kind(experiment, folder / HEADER), read_lines(folder / EPISODES, kind.record_kind)


def written(results: BenchmarkResults) -> bytes:
    """Return the tables as Markdown."""
    caption = " ".join((results.table.caption, *results.remarks))
    text = to_markdown([replace(results.table, caption=caption), *results.behind]).encode()
    return text + SIGN + b"\n"
