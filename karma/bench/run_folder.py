"""A run is a folder: what it depends on, its records, its timings, its step logs.

An episode is done when all it leaves is on the disk: first its pictures and step log, each written
whole or not at all, then a line of `timings.jsonl`, and last a line of `episodes.jsonl`. Whatever a
killed run left half done is not counted and is written again, so the files end up the same.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from karma.bench.configuration import CONFIG, Config, all_apart, read_config
from karma.bench.figures import figures, plain
from karma.bench.folder import brief, changed, check_ours, refuse_other, replace_file, sweep
from karma.bench.records import (
    EpisodeRecord,
    EpisodeTiming,
    Key,
    read_records,
    read_timings,
    write_record,
)
from karma.bench.steps import FOLDER as STEPS
from karma.bench.steps import packed, steps_path
from karma.errors import FileError
from karma.files import read_json, to_json, write_atomic

FORMAT = 6  # of the folder; 1 had times among the records, 2 no methods or rooms, 3 no tours,
# 4 no engine and no refused prompts, 5 no goals met at the start and no tasks left unjudged
HEADER, EPISODES, TIMINGS, RESULTS = (
    "header.json", "episodes.jsonl", "timings.jsonl", "results.json",
)  # fmt: skip
CELLS, SWEEP = "cells", "sweep.json"  # of a sweep's folder, see `karma.bench.sweep_folder`
_OURS = (EPISODES, TIMINGS, RESULTS, STEPS, "short_term", "maps", "scenes", CONFIG, HEADER)


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """Where a run was begun; decides nothing."""

    platform: str
    cpu: str
    cores: int
    memory_mb: int | None
    threads: int  # of each planner
    devices: tuple[str, ...] = ()  # that llama.cpp can compute on, as it names and describes them


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What a run's records depend on; a folder never mixes two."""

    name: str  # of the experiment
    experiment: str  # SHA-256 of its content
    tasks: str  # SHA-256 of the tasks
    versions: Mapping[str, str]  # of this package and of what computes
    models: Mapping[str, str]  # role -> name and SHA-256
    prompts: Mapping[str, str]  # template -> SHA-256
    scenes: Mapping[str, str]  # name -> SHA-256
    network: bool = False  # started with --allow-network
    steps: bool = True  # whether step logs are kept
    format: int
    machine: Machine = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """All that one episode leaves."""

    record: EpisodeRecord
    timing: EpisodeTiming
    steps: bytes = b""  # lines of its log
    files: Mapping[str, bytes] = field(default_factory=dict)  # path below the run folder -> content


@dataclass(frozen=True, slots=True, kw_only=True)
class RunData:
    """A run as it was read, finished or not."""

    folder: Path
    header: Header
    records: tuple[EpisodeRecord, ...]  # in canonical order once it is finished
    timings: Mapping[Key, EpisodeTiming]
    finished: bool  # all episodes that were asked for are there


def read_run(folder: str | Path) -> RunData:
    """Read a run's folder; changes nothing in it.

    Raises:
        FileError: there is no run, it is of an earlier form, or a line is damaged.
    """
    folder = Path(folder)
    header = read_header(folder / HEADER)
    return RunData(
        folder=folder,
        header=header,
        records=tuple({r.key: r for r in read_records(folder / EPISODES)}.values()),
        timings={timing.key: timing for timing in read_timings(folder / TIMINGS)},
        finished=(folder / RESULTS).exists(),
    )


def read_header(path: Path) -> Header:
    """Read what a run depends on.

    Raises:
        FileError: there is none, it is of an earlier form, or a benchmark's.
    """
    if not path.exists():
        if (path.parent / SWEEP).exists():
            fix = f"name one of the folders in {path.parent / CELLS}"
            raise FileError(path.parent, "a sweep, of many runs", fix=fix)
        raise FileError(path, "there is no run in this folder", fix="karma eval FILE --out FOLDER")
    if benchmark := benchmark_in(path.parent):
        raise FileError(
            path,
            f"a run of the benchmark {benchmark}, which has records of its own: they are not"
            " read here",
            fix=f"karma table {path.parent}",
        )
    fix = "run it again: karma eval FILE --fresh, or --out another folder"
    try:
        header = read_json(path, Header)
    except FileError as error:
        reason = f"this folder holds no run of the present form ({error.reason})"
        raise FileError(path, reason, fix=fix) from error
    if header.format != FORMAT:
        raise FileError(path, f"the run is of form {header.format}, not {FORMAT}", fix=fix)
    return header


class _AnyHeader(msgspec.Struct, frozen=True):
    """What the headers of all forms have."""

    experiment: str


class _Headed(msgspec.Struct, frozen=True):
    benchmark: str = ""


def benchmark_in(folder: Path) -> str:
    """Return the benchmark that a folder holds a run of; "" where it holds none, or another run."""
    try:
        return read_json(folder / HEADER, _Headed).benchmark
    except FileError:
        return ""


def differences(
    old: Header, new: Header, told: Config | None = None, now: Config | None = None
) -> list[str]:
    """Return what tells two headers apart, in words.

    Args:
        old: of a run.
        new: of another one.
        told: what the first was told, if that is known; then options that differ are named.
        now: what the second was told, likewise.
    """
    options = all_apart(told, now) if told is not None and now is not None else []
    found = [
        f"{what}: {brief(str(one))} became {brief(str(other))}"
        for what, one, other in (
            ("name", old.name, new.name),
            ("experiment file", old.experiment, new.experiment),
            ("tasks", old.tasks, new.tasks),
            ("--allow-network", old.network, new.network),
            ("step logs", old.steps, new.steps),
        )
        if one != other and not (what == "experiment file" and options)
    ]
    found += options if old.experiment != new.experiment else []
    for what in ("versions", "models", "prompts", "scenes"):
        found += changed(what, getattr(old, what), getattr(new, what))
    return found


class RunFolder:
    """The folder that a run writes.

    Args:
        path: of the folder.
        steps: whether episodes leave step logs.
    """

    def __init__(self, path: Path, *, steps: bool) -> None:
        self.path, self._steps = path, steps
        self._is_ours = False  # what lies in it was seen to be a run's, or beside one

    def clear(self) -> None:
        """Throw away what an earlier run left.

        Raises:
            FileError: what is there is no run's.
        """
        if not self._is_ours:
            check_ours(self.path, _OURS, header=HEADER)
        if (self.path / HEADER).exists() and not (self.path / EPISODES).exists():
            read_json(self.path / HEADER, _AnyHeader, fix="--out another folder")
        if not any((self.path / name).exists() for name in (HEADER, EPISODES)):
            return
        self._is_ours = True
        for name in _OURS:
            place = self.path / name
            if place.is_dir():
                shutil.rmtree(place)
            else:
                place.unlink(missing_ok=True)

    def claim(self, header: Header, config: Config, *, fix: str) -> None:
        """Make the folder that run's, or see that it is; a run without an episode is no obstacle.

        Args:
            header: what the run depends on.
            config: what it was told, which is kept beside it.
            fix: what helps where the folder holds another run.

        Raises:
            FileError: it holds another run; names what differs.
        """
        path = self.path / HEADER
        if (self.path / SWEEP).exists():
            raise FileError(self.path, "this folder holds a sweep", fix="--out another folder")
        if not self._is_ours:
            check_ours(self.path, _OURS, header=HEADER)
        found = ["header: none"]
        if path.exists():
            found = differences(read_header(path), header, read_config(self.path), config)
        begun = bool(read_records(self.path / EPISODES))
        if found and not begun:
            self.clear()
        if not path.exists() and not begun:
            write_atomic(path, to_json(header, indent=2))
        else:
            refuse_other(path, found, fix=fix)
        replace_file(self.path / CONFIG, to_json(config, indent=2))

    def done(self) -> tuple[list[EpisodeRecord], dict[Key, EpisodeTiming]]:
        """Return the episodes that are done; traces of those that are not are swept away.

        Raises:
            FileError: a line that is not the last is damaged.
        """
        sweep(self.path, _OURS)
        timings = {timing.key: timing for timing in read_timings(self.path / TIMINGS)}
        found = {record.key: record for record in read_records(self.path / EPISODES)}
        kept = {key: found[key] for key in found if key in timings and self._has_steps(key)}
        timings = {key: timings[key] for key in kept}
        self._rewrite(kept, timings)
        return list(kept.values()), timings

    def reopen(self) -> None:
        """Take back what says that the run is finished, as more is to be done."""
        (self.path / RESULTS).unlink(missing_ok=True)

    def commit(self, one: Finished) -> None:
        """See an episode to the disk; it is done when this returns.

        Raises:
            FileError: the disk is full.
        """
        for name, data in one.files.items():
            if not (self.path / name).exists():
                write_atomic(self.path / name, data)
        if self._steps:
            write_atomic(steps_path(self.path, *one.record.key), packed(one.steps))
        write_record(self.path / TIMINGS, one.timing)
        write_record(self.path / EPISODES, one.record)

    def put_only(self, header: Header, one: Finished) -> None:
        """Have one episode in the folder, finished as far as it goes, in place of what was there.

        Raises:
            FileError: the disk is full.
        """
        for name, data in one.files.items():
            replace_file(self.path / name, data)
        if self._steps:
            replace_file(steps_path(self.path, *one.record.key), packed(one.steps))
        replace_file(self.path / TIMINGS, to_json(one.timing))
        replace_file(self.path / EPISODES, to_json(one.record))
        replace_file(self.path / RESULTS, to_json(plain(figures([one.record])), indent=2))
        replace_file(self.path / HEADER, to_json(header, indent=2))

    def finish(self, order: Sequence[Key]) -> None:
        """Put all lines in their final order, and write what they add up to.

        Args:
            order: the keys of all episodes, as they stand at the end.
        """
        records, timings = self.done()
        rank = {key: number for number, key in enumerate(order)}
        order = sorted((record.key for record in records), key=rank.__getitem__)
        by_key = {record.key: record for record in records}
        self._rewrite({k: by_key[k] for k in order}, {k: timings[k] for k in order})
        lines = figures([by_key[key] for key in order])  # without seconds: no run repeats them
        replace_file(self.path / RESULTS, to_json(plain(lines), indent=2))

    # ------------------------------------------------------------- parts

    def _has_steps(self, key: Key) -> bool:
        return not self._steps or steps_path(self.path, *key).exists()

    def _rewrite(
        self, records: Mapping[Key, EpisodeRecord], timings: Mapping[Key, EpisodeTiming]
    ) -> None:
        for name, lines in ((TIMINGS, timings), (EPISODES, records)):
            data = b"".join(to_json(line) for line in lines.values())
            if data or (self.path / name).exists():
                replace_file(self.path / name, data)
