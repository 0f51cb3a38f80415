"""A run is a folder: what it depends on, its records, its timings, its step logs.

An episode is done when all it leaves is on the disk: first its pictures and step log, each written
whole or not at all, then a line of `timings.jsonl`, and last a line of `episodes.jsonl`. Whatever a
killed run left half done is not counted and is written again, so the files end up the same.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self

from karma.agent.seeing.picture_states import PICTURES, picture_name
from karma.errors import FileError
from karma.files import TEMPORARY, append_line, to_json, write_atomic
from karma.journal.header import (
    CONFIG,
    EPISODES,
    RESULTS,
    TABLE,
    TIMINGS,
    Config,
    Header,
    read_config,
)
from karma.journal.owned_folder import (
    HEADER,
    MARK,
    Kind,
    OwnedFolder,
    check_sealed,
    read_lines,
    refuse_other,
)
from karma.journal.records import (
    NOT_RUN,
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


class OwnHeader(Protocol):
    """What a run of another kind than ours depends on."""

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it; FileError where it is damaged, or another's."""

    @property
    def names(self) -> frozenset[str]:
        """The files that such a run may write."""

    def apart(self, new: Any) -> list[str]:
        """Return what tells another one apart, in words."""


_NO_SCENES: Mapping[str, bytes] = {}


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
    """Read a run's folder, and change nothing in it; errors as `Header.read` and `read_lines`."""
    folder = Path(folder)
    header = Header.read(folder)
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
    """The folder that a run writes."""

    def __init__(
        self, path: Path, *, steps: bool, kind: Kind = "run", records: type[Any] = EpisodeRecord
    ) -> None:
        self.path, self._steps, self._records = path, steps, records
        self._timings: type[Any] = EpisodeTiming if records is EpisodeRecord else PlayedTiming
        self._kind: Kind = kind
        self._owned = OwnedFolder(path, kind)

    def clear(self) -> None:
        """Throw away what an earlier run left; FileError where what is there is no run's."""
        if self._owned.look():
            for picture in (self.path / PICTURES).glob("*.png"):
                if picture.stem == picture_name(picture.read_bytes()):
                    picture.unlink()
            self._owned.fold(f"{PICTURES}/picture")
            self._owned.clear()

    def claim(
        self,
        header: Header | OwnHeader,
        config: Config | None,
        *,
        fix: str,
        scenes: Mapping[str, bytes] = _NO_SCENES,
    ) -> None:
        """Make the folder that run's, or see that it is; a run without an episode is no obstacle.

        Without `config` the header says all; `scenes` are rooms that the tasks bring along, by
        their path below the folder. FileError names what differs, or whose it is.
        """
        path, data = self.path / HEADER, to_json(header, indent=2)
        self._owned.look()
        check_sealed(self.path)
        found = ["header: none"]
        if path.exists():
            found = self._apart(header, config)
        begun = bool(read_lines(self.path / EPISODES, self._records))
        if found and not begun:
            self.clear()
        if path.exists() or begun:
            refuse_other(path, found, fix=fix)
        else:
            self._owned.begin({*header.names, *scenes}, data)
            self._owned.write(HEADER, data)
        told = {} if config is None else {CONFIG: to_json(config, indent=2)}
        for name, content in {**told, **scenes}.items():
            self._owned.write(name, content)

    def reserve(self) -> None:
        """Make a folder in which nothing was written this run's; FileError where something was."""
        if self._owned.look() and any((self.path / name).exists() for name in self._owned.names):
            raise FileError(self.path, "holds another conversation", fix="--out another folder")
        self._owned.begin(())

    def release(self) -> None:
        """Take the mark away where nothing else was written."""
        if [one.name for one in self.path.iterdir()] == [MARK]:
            (self.path / MARK).unlink()

    def done(
        self, together: Iterable[Sequence[Key]] = ()
    ) -> tuple[list[Any], dict[Key, EpisodeTiming | PlayedTiming]]:
        """Return the episodes that are done; traces of those that are not are swept away.

        Episodes that stand `together` count only if all of them are done.
        """
        self._owned.sweep()
        for left in (self.path / PICTURES).glob(f".*{TEMPORARY}"):
            left.unlink(missing_ok=True)
        timings = {one.key: one for one in read_lines(self.path / TIMINGS, self._timings)}
        found = {key_of(one): one for one in read_lines(self.path / EPISODES, self._records)}

        def there(key: Key) -> bool:
            return all((self.path / name).exists() for name in self._logs([key]))

        kept = {key: found[key] for key in found if key in timings and there(key)}
        for keys in together:
            if not kept.keys() >= {*keys}:
                kept = {key: kept[key] for key in kept if key not in keys}
        timings = {key: timings[key] for key in kept}
        if kept.keys() != found.keys():
            (self.path / RESULTS).unlink(missing_ok=True)  # it is not finished any more
        self._rewrite(kept, timings)
        return list(kept.values()), timings

    def reopen(self) -> None:
        """Take back what says that the run is finished, as more is to be done."""
        for name in self._owned.names & {RESULTS, NOT_RUN, TABLE}:
            (self.path / name).unlink(missing_ok=True)

    def put_aside(self, one: NotRun) -> None:
        """Keep why an episode was not run."""
        append_line(self.path / NOT_RUN, to_json(one))

    def commit(self, one: Finished) -> None:
        """See an episode to the disk; it is done when this returns."""
        for name, data in one.files.items():
            if not (self.path / name).exists():
                write_atomic(self.path / name, data)
        if self._steps:
            self._write_steps(one)
        append_line(self.path / TIMINGS, to_json(one.timing))
        append_line(self.path / EPISODES, to_json(one.record))

    def put_only(self, header: Header, one: Finished) -> None:
        """Have one episode that nobody judges in the folder, in place of itself before."""
        self.reopen()
        for name, data in one.files.items():
            self._owned.write(name, data)
        self._write_steps(one)
        for name, data in (
            (TIMINGS, to_json(one.timing)),
            (EPISODES, to_json(one.record)),
            (HEADER, to_json(header, indent=2)),
        ):
            self._owned.write(name, data)
        self._owned.seal([EPISODES, *self._logs([one.record.key]), *one.files], RESULTS, b"[]\n")

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
            self._owned.write(name, data)
        self._owned.seal([EPISODES, *self._logs(order)], RESULTS, results)

    # ------------------------------------------------------------- parts

    def _apart(self, header: Header | OwnHeader, config: Config | None) -> list[str]:
        """Return what tells the folder's run apart from another one."""
        if isinstance(header, Header):
            return Header.read(self.path).apart(header, read_config(self.path), config)
        kind: type[Any] = type(header)
        return list(kind.read(self.path).apart(header))

    def _write_steps(self, one: Finished) -> None:
        self._owned.write(steps_path(Path(), *one.record.key).as_posix(), packed(one.steps))

    def _logs(self, keys: Iterable[Key]) -> list[str]:
        """Return the names of the step logs of episodes; none where none are kept."""
        return [steps_path(Path(), *key).as_posix() for key in keys if self._steps]

    def _rewrite(
        self, records: Mapping[Key, Any], timings: Mapping[Key, EpisodeTiming | PlayedTiming]
    ) -> None:
        for name, lines in ((TIMINGS, timings), (EPISODES, records)):
            data = b"".join(to_json(line) for line in lines.values())
            if data or (self.path / name).exists():
                self._owned.write(name, data)
