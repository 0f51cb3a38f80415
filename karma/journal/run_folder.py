"""A run is a folder: what it depends on, its records, its timings, its step logs.

An episode is done when all it leaves is on the disk: first its pictures and step log, each written
whole or not at all, then a line of `timings.jsonl`, and last a line of `episodes.jsonl`. Whatever a
killed run left half done is not counted and is written again, so the files end up the same.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from karma.errors import FileError
from karma.files import TEMPORARY, read_bytes, read_json, to_json, write_atomic
from karma.journal.folder import brief, changed, refuse_other
from karma.journal.not_run import FILE as NOT_RUN
from karma.journal.not_run import NotRun, read_not_run
from karma.journal.owned_folder import HEADER, MARK, Kind, OwnedFolder, check_sealed
from karma.journal.records import (
    EpisodeRecord,
    EpisodeTiming,
    Key,
    read_records,
    read_timings,
    write_record,
)
from karma.journal.steps import FOLDER as STEPS
from karma.journal.steps import packed, steps_path
from karma.journal.told import CONFIG, Config, all_apart, read_config
from karma.methods.picture_states import FOLDER as PICTURES
from karma.methods.picture_states import picture_name

FORMAT = 6  # of the folder; 1 had times among the records, 2 no methods or rooms, 3 no tours,
# 4 no engine and no refused prompts, 5 no goals met at the start and no tasks left unjudged
EPISODES, TIMINGS, RESULTS = "episodes.jsonl", "timings.jsonl", "results.json"
CELLS, SWEEP = "cells", "sweep.json"  # of a sweep's folder, see `karma.bench.sweep_folder`
_NO_SCENES: Mapping[str, bytes] = {}


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
    not_run: tuple[NotRun, ...] = ()  # when it was last at work


def read_run(folder: str | Path) -> RunData:
    """Read a run's folder; changes nothing in it.

    Raises:
        FileError: there is no run, it is of an earlier form, or a line is damaged.
    """
    folder = Path(folder)
    header = read_header(folder / HEADER)
    check_sealed(folder)
    return RunData(
        folder=folder,
        header=header,
        records=tuple({r.key: r for r in read_records(folder / EPISODES)}.values()),
        timings={timing.key: timing for timing in read_timings(folder / TIMINGS)},
        finished=(folder / RESULTS).exists(),
        not_run=read_not_run(folder),
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
    fix = "run it again: karma eval FILE --out another folder"
    try:
        header = read_json(path, Header)
    except FileError as error:
        reason = f"this folder holds no run of the present form ({error.reason})"
        raise FileError(path, reason, fix=fix) from error
    if header.format != FORMAT:
        raise FileError(path, f"the run is of form {header.format}, not {FORMAT}", fix=fix)
    return header


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
        kind: of run.
    """

    def __init__(self, path: Path, *, steps: bool, kind: Kind = "run") -> None:
        self.path, self._steps = path, steps
        self._owned = OwnedFolder(path, kind)

    def clear(self) -> None:
        """Throw away what an earlier run left.

        Raises:
            FileError: what is there is no run's.
        """
        if self._owned.look():
            for picture in (self.path / PICTURES).glob("*.png"):
                if picture.stem == picture_name(picture.read_bytes()):
                    picture.unlink()
            self._owned.fold(f"{PICTURES}/picture")
            self._owned.clear()

    def claim(
        self,
        header: Header,
        config: Config,
        *,
        fix: str,
        scenes: Mapping[str, bytes] = _NO_SCENES,
    ) -> None:
        """Make the folder that run's, or see that it is; a run without an episode is no obstacle.

        Args:
            header: what the run depends on.
            config: what it was told, which is kept beside it.
            fix: what helps where the folder holds another run.
            scenes: rooms that the tasks bring along, path below the folder -> content.

        Raises:
            FileError: it holds another run, and what differs is named; or it is somebody else's.
        """
        path, data = self.path / HEADER, to_json(header, indent=2)
        self._adopt(header, config)
        self._owned.look()
        check_sealed(self.path)
        found = ["header: none"]
        if path.exists():
            found = differences(read_header(path), header, read_config(self.path), config)
        begun = bool(read_records(self.path / EPISODES))
        if found and not begun:
            self.clear()
        if path.exists() or begun:
            refuse_other(path, found, fix=fix)
        else:
            self._owned.begin({*_names(header), *scenes}, data)
            self._owned.write(HEADER, data)
        for name, room in {CONFIG: to_json(config, indent=2), **scenes}.items():
            self._owned.write(name, room)

    def reserve(self) -> None:
        """Make a folder in which nothing was written yet this run's.

        Raises:
            FileError: something is in it.
        """
        if self._owned.look() and any((self.path / name).exists() for name in self._owned.names):
            raise FileError(self.path, "holds another conversation", fix="--out another folder")
        self._owned.begin(())

    def release(self) -> None:
        """Take the mark away where nothing else was written."""
        if [one.name for one in self.path.iterdir()] == [MARK]:
            (self.path / MARK).unlink()

    def done(self) -> tuple[list[EpisodeRecord], dict[Key, EpisodeTiming]]:
        """Return the episodes that are done; traces of those that are not are swept away.

        Raises:
            FileError: a line that is not the last is damaged.
        """
        self._owned.sweep()
        for left in (self.path / PICTURES).glob(f".*{TEMPORARY}"):
            left.unlink(missing_ok=True)
        timings = {timing.key: timing for timing in read_timings(self.path / TIMINGS)}
        found = {record.key: record for record in read_records(self.path / EPISODES)}
        kept = {key: found[key] for key in found if key in timings and self._has_steps(key)}
        timings = {key: timings[key] for key in kept}
        if kept.keys() != found.keys():
            (self.path / RESULTS).unlink(missing_ok=True)  # it is not finished any more
        self._rewrite(kept, timings)
        return list(kept.values()), timings

    def reopen(self) -> None:
        """Take back what says that the run is finished, as more is to be done."""
        for name in (RESULTS, NOT_RUN):
            (self.path / name).unlink(missing_ok=True)

    def commit(self, one: Finished) -> None:
        """See an episode to the disk; it is done when this returns.

        Raises:
            FileError: the disk is full.
        """
        for name, data in one.files.items():
            if not (self.path / name).exists():
                write_atomic(self.path / name, data)
        if self._steps:
            self._write_steps(one)
        write_record(self.path / TIMINGS, one.timing)
        write_record(self.path / EPISODES, one.record)

    def put_only(self, header: Header, one: Finished) -> None:
        """Have one episode that nobody judges in the folder, in place of itself before.

        Raises:
            FileError: the disk is full, or somebody's file is in the way.
        """
        for name, data in one.files.items():
            self._owned.write(name, data)
        self._write_steps(one)
        for name, data in (
            (TIMINGS, to_json(one.timing)),
            (EPISODES, to_json(one.record)),
            (RESULTS, b"[]\n"),
            (HEADER, to_json(header, indent=2)),
        ):
            self._owned.write(name, data)
        self._owned.settle()

    def finish(
        self, order: Sequence[Key], add_up: Callable[[Sequence[EpisodeRecord]], bytes]
    ) -> None:
        """Put all lines in their final order, and write what they add up to.

        Args:
            order: the keys of all episodes, as they stand at the end.
            add_up: makes the results of the records, as they are written; without seconds, since no
                run repeats those.
        """
        records, timings = self.done()
        rank = {key: number for number, key in enumerate(order)}
        order = sorted((record.key for record in records), key=rank.__getitem__)
        by_key = {record.key: record for record in records}
        self._rewrite({k: by_key[k] for k in order}, {k: timings[k] for k in order})
        self._owned.settle(seal=EPISODES, by=RESULTS)
        self._owned.write(RESULTS, add_up([by_key[key] for key in order]))

    # ------------------------------------------------------------- parts

    def _adopt(self, header: Header, config: Config) -> None:
        """Take over the same run as an earlier version left it, without a mark.

        Raises:
            FileError: it is another run.
        """
        path = self.path / HEADER
        if (self.path / MARK).exists() or not _is_header(path):
            return
        found = differences(read_header(path), header, read_config(self.path), config)
        refuse_other(path, found, fix="--out another folder")
        there = [*self.path.glob(f"{STEPS}/*/*.jsonl.gz")]
        there += [one for one in self.path.glob("scenes/*.json") if one.stem in header.scenes]
        names = {one.relative_to(self.path).as_posix() for one in there}
        self._owned.adopt(names | _names(header), read_bytes(path))

    def _write_steps(self, one: Finished) -> None:
        path = steps_path(self.path, *one.record.key)
        self._owned.write(path.relative_to(self.path).as_posix(), packed(one.steps))

    def _has_steps(self, key: Key) -> bool:
        return not self._steps or steps_path(self.path, *key).exists()

    def _rewrite(
        self, records: Mapping[Key, EpisodeRecord], timings: Mapping[Key, EpisodeTiming]
    ) -> None:
        for name, lines in ((TIMINGS, timings), (EPISODES, records)):
            data = b"".join(to_json(line) for line in lines.values())
            if data or (self.path / name).exists():
                self._owned.write(name, data)


def _names(header: Header) -> set[str]:
    """Return the files that a run may write, but for those of its episodes."""
    maps = (f"maps/{scene}.json" for scene in header.scenes)
    return {HEADER, CONFIG, EPISODES, TIMINGS, RESULTS, NOT_RUN, *maps}


def _is_header(path: Path) -> bool:
    """Return whether a file is the header of a run of the present form."""
    try:
        return bool(read_header(path))
    except FileError:
        return False
