"""A run is a folder: what it depends on, its records, its timings, its step logs.

An episode is done when all it leaves is on the disk: first its pictures and step log, each written
whole or not at all, then a line of `timings.jsonl`, and last a line of `episodes.jsonl`. Whatever a
killed run left half done is not counted and is written again, so the files end up the same.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from karma.errors import FileError
from karma.files import LARGEST_LOG, append_line, inside, read_bytes, to_json, write_atomic
from karma.journal import folder as folders
from karma.journal.folder import (
    EPISODES,
    HEADER,
    MARK,
    NOT_RUN,
    RESULTS,
    TIMINGS,
    check_sealed,
    read_lines,
    replace_file,
)
from karma.journal.header import Header, kind_in
from karma.journal.records import (
    EpisodeRecord,
    EpisodeTiming,
    Key,
    NotRun,
    PlayedTiming,
    key_of,
    read_not_run,
    read_records,
)
from karma.journal.steps import packed, steps_path

_NO_FILES: Mapping[str, bytes] = {}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """All that one episode leaves."""

    record: Any  # an `EpisodeRecord`, or a benchmark's own
    timing: EpisodeTiming | PlayedTiming
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
    """Read the folder of a run of our own tasks, or of a conversation, and change nothing in it.

    Raises:
        FileError: there is none, a line of it is damaged, or it is another kind of run.
    """
    folder = Path(folder)
    header = Header.read(folder)
    if header.kind == "figure":
        fix = f"karma report {folder}"
        raise FileError(folder, "a figure of policies, which has no episodes", fix=fix)
    if header.kind == "benchmark":
        reason = f"a run of the benchmark {header.options['benchmark']}, not of our own tasks"
        raise FileError(folder, reason, fix=f"karma table {folder}")
    check_sealed(folder)
    return RunData(
        folder=folder,
        header=header,
        records=tuple({r.key: r for r in read_records(folder / EPISODES)}.values()),
        timings={timing.key: timing for timing in read_lines(folder / TIMINGS, EpisodeTiming)},
        finished=(folder / RESULTS).exists(),
        not_run=read_not_run(folder),
    )


class RunFolder:
    """The folder that a run writes; with `steps`, a step log per episode."""

    def __init__(self, path: Path, *, steps: bool, records: type[Any] = EpisodeRecord) -> None:
        self.path, self._steps, self._records = path, steps, records
        self._timings: type[Any] = EpisodeTiming if records is EpisodeRecord else PlayedTiming

    def make_way(self, header: Header, *, fresh: bool) -> Path | None:
        """Set an earlier run aside, and return its new path; None where there is none.

        Without `fresh` only another run gives way, and that only if it has no episode.

        Raises:
            FileError: the folder has no mark and holds files, or cannot be renamed.
            KarmaError: another run is at work in it.
        """
        with folders.locked(self.path):
            if not folders.is_begun(self.path):
                return None
            if not fresh:
                idle = (self.path / HEADER).exists() and not self._has_records()
                fresh = idle and bool(Header.read(self.path).apart(header))
            return folders.set_aside(self.path) if fresh else None

    def claim(self, header: Header, *, fix: str, scenes: Mapping[str, bytes] = _NO_FILES) -> None:
        """Make the folder that run's, or check that it is.

        `scenes` are rooms that the tasks bring along, by their path below the folder.

        Raises:
            FileError: names what differs, or a file that no run has written.
        """
        path = self.path / HEADER
        if folders.is_begun(self.path):
            check_sealed(self.path)
            known = kind_in(self.path) is not None
            found = Header.read(self.path).apart(header) if known else ["header: none"]
            if found and (known or self._has_records()):
                reason = "this folder holds a run of something else:\n  " + "\n  ".join(found)
                raise FileError(path, reason, fix=fix)
        if not path.exists():
            data = to_json(header, indent=2)
            folders.begin(self.path, data)
            write_atomic(inside(self.path, HEADER), data)
        for name, content in scenes.items():
            place = inside(self.path, name)
            if place.exists() and read_bytes(place) != content:
                raise FileError(place, "is not the room that the tasks bring along", fix=fix)
            replace_file(place, content)

    def _has_records(self) -> bool:
        path = self.path / EPISODES
        return path.exists() and b"\n" in read_bytes(path, most=LARGEST_LOG)

    def reserve(self) -> None:
        """Mark a folder in which no run has begun; FileError for a folder that holds one."""
        if folders.is_begun(self.path) and [one.name for one in self.path.iterdir()] != [MARK]:
            raise FileError(self.path, "holds another conversation", fix="--out another folder")
        folders.begin(self.path)

    def release(self) -> None:
        """Remove the mark if nothing else was written."""
        if [one.name for one in self.path.iterdir()] == [MARK]:
            (self.path / MARK).unlink()

    def done(
        self, together: Iterable[Sequence[Key]] = ()
    ) -> tuple[list[Any], dict[Key, EpisodeTiming | PlayedTiming]]:
        """Return the episodes that are done; traces of those that are not are swept away.

        Episodes that stand `together` count only if all of them are done.
        """
        folders.sweep(self.path)
        timings = {one.key: one for one in read_lines(self.path / TIMINGS, self._timings)}
        found = {key_of(one): one for one in read_lines(self.path / EPISODES, self._records)}

        def is_logged(key: Key) -> bool:
            return all((self.path / name).exists() for name in self._logs([key]))

        kept = {key: found[key] for key in found if key in timings and is_logged(key)}
        for keys in together:
            if not kept.keys() >= {*keys}:
                kept = {key: kept[key] for key in kept if key not in keys}
        timings = {key: timings[key] for key in kept}
        if kept.keys() != found.keys():
            self._unfinish()
        self._rewrite(kept, timings)
        return list(kept.values()), timings

    def reopen(self) -> None:
        """Take back what says that the run is finished, as more is to be done."""
        self._unfinish()
        (self.path / NOT_RUN).unlink(missing_ok=True)

    def put_aside(self, one: NotRun) -> None:
        """Keep why an episode was not run."""
        append_line(inside(self.path, NOT_RUN), to_json(one))

    def commit(self, one: Finished) -> None:
        """See an episode to the disk; it is done when this returns."""
        for name, data in one.files.items():
            if not (place := inside(self.path, name)).exists():
                write_atomic(place, data)
        self._write_steps(one)
        append_line(inside(self.path, TIMINGS), to_json(one.timing))
        append_line(inside(self.path, EPISODES), to_json(one.record))

    def put_only(self, header: Header, one: Finished) -> None:
        """Have one episode that nobody judges in the folder, in place of itself before."""
        self.reopen()
        files = {
            **one.files,
            TIMINGS: to_json(one.timing),
            EPISODES: to_json(one.record),
            HEADER: to_json(header, indent=2),
        }
        self._write_steps(one)
        for name, data in files.items():
            replace_file(inside(self.path, name), data)
        sealed = [EPISODES, *self._logs([key_of(one.record)]), *one.files]
        folders.seal(self.path, sealed, b"[]\n")

    def finish(
        self, order: Sequence[Key], add_up: Callable[[Sequence[Any]], Mapping[str, bytes]]
    ) -> None:
        """Put all lines in their final order, and write what they add up to.

        `order` has the keys of all episodes. `add_up` makes the results of the records, as they are
        written, and what else there is to write, by name; without seconds, since no run repeats
        those.
        """
        records, timings = self.done()
        rank = {key: number for number, key in enumerate(order)}
        by_key = {key_of(record): record for record in records}
        order = sorted(by_key, key=rank.__getitem__)
        self._rewrite({k: by_key[k] for k in order}, {k: timings[k] for k in order})
        made = dict(add_up([by_key[key] for key in order]))
        results = made.pop(RESULTS)
        for name, data in made.items():
            folders.write_made(inside(self.path, name), data)
        folders.seal(self.path, [EPISODES, *self._logs(order)], results)

    # ------------------------------------------------------------- parts

    def _write_steps(self, one: Finished) -> None:
        for name in self._logs([key_of(one.record)]):
            write_atomic(inside(self.path, name), packed(one.steps))

    def _unfinish(self) -> None:
        """Remove the results, as the run is not finished any more."""
        folders.check_results(self.path)
        (self.path / RESULTS).unlink(missing_ok=True)

    def _logs(self, keys: Iterable[Key]) -> list[str]:
        """Return the names of the step logs of episodes; none where none are kept."""
        return [steps_path(Path(), *key).as_posix() for key in keys if self._steps]

    def _rewrite(
        self, records: Mapping[Key, Any], timings: Mapping[Key, EpisodeTiming | PlayedTiming]
    ) -> None:
        for name, lines in ((TIMINGS, timings), (EPISODES, records)):
            data = b"".join(to_json(line) for line in lines.values())
            if data or (self.path / name).exists():
                replace_file(inside(self.path, name), data)
