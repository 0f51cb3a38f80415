"""A conversation as a run's folder: one episode of what was said, opened by `karma report`.

The same records, step log and header as an experiment's; nobody judges it, as it has no goals.
"""

from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from weakref import finalize

import msgspec

from karma.errors import FileError
from karma.files import read_bytes
from karma.journal.folder import locked
from karma.journal.header import Header
from karma.journal.provenance import header_of
from karma.journal.records import SAID, EpisodeRecord, SubTaskRecord, Turn, turns_file
from karma.journal.run_folder import Finished, RunFolder
from karma.journal.writer import EpisodeWriter
from karma.loading.models import Models, Row
from karma.types.roles import Resources
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task

TALKS = Path("runs/talks")
_FIX = "--out another folder"


class TalkFolder:
    """A folder that one conversation has for itself, as long as it lives.

    It is made where it is not there; None: the next of the scene that is free below `talks`, such
    as `kitchen_1-1`, then `kitchen_1-2`.

    Raises:
        FileError: it cannot be made, or something is in it.
        KarmaError: another conversation is at work in it.
    """

    def __init__(self, folder: Path | None, scene: str, talks: Path = TALKS) -> None:
        made = folder is None or not folder.exists()
        self.folder = _next(scene, talks) if folder is None else folder
        held = ExitStack()
        held.enter_context(locked(self.folder))
        self.files = RunFolder(self.folder, steps=True)
        try:
            self.files.reserve()
        except BaseException:
            held.close()
            raise
        self.leave = finalize(self, _left, self.files, held, made)


def _left(files: RunFolder, held: ExitStack, made: bool) -> None:
    """Let go of a folder; where nothing was said, nothing of it stays."""
    with held, suppress(OSError):
        files.release()
        if made:
            files.path.rmdir()


def _next(scene: str, talks: Path) -> Path:
    """Make the next folder that is free, which nobody else can have made."""
    for number in count(1):
        place = talks / f"{scene}-{number}"
        try:
            talks.mkdir(parents=True, exist_ok=True)
            place.mkdir()
        except FileExistsError:
            if talks.is_dir():
                continue
            raise FileError(talks, "is no folder", fix=_FIX) from None
        except OSError as error:
            raise FileError(place, f"cannot be made: {error.strerror}", fix=_FIX) from error
        return place
    raise AssertionError


class Keeper:
    """Writes a conversation into its folder, whole each time.

    `models` are None where resources were given, in place of names.
    """

    def __init__(
        self, place: TalkFolder, scene: SceneRef, row: Row, models: Models | None, given: Resources
    ) -> None:
        self.place, self._scene, self._row = place, scene, row
        self._models, self._given = models, given
        own = read_bytes(Path(scene.path)) if scene.path else None
        self._scenes = {} if own is None else {f"scenes/{scene.name}.json": own}

    def write(
        self,
        done: Iterable[SubTaskRecord],
        turns: Iterable[Turn],
        part: EpisodeWriter,
        files: Mapping[str, bytes],
    ) -> None:
        """Write all that was said so far.

        Raises:
            FileError: the folder cannot be written.
        """
        subtasks = tuple(done)
        record = EpisodeRecord(
            row=self._row.name,
            method=part.method,
            task=SAID,
            kind=SAID,
            scene=self._scene.name,
            seed=0,
            notes=(),
            subtasks=subtasks,
            unjudged="nobody judges what was said",
            tours=tuple(part.tours.values()),
        )
        finished = Finished(
            record=record,
            timing=part.times.of(record),
            steps=part.steps.data(),
            files={**files, **self._scenes, **turns_file(turns)},
        )
        self.place.files.put_only(self._header(subtasks), finished)

    def _header(self, done: Iterable[SubTaskRecord]) -> Header:
        said = tuple(SubTask(instruction=one.instruction) for one in done)
        task = Task(id=SAID, kind="sequence", scene=self._scene, subtasks=said, group=SAID)
        models = self._models or Models()
        told = {"rows": [msgspec.to_builtins(self._row)], "models": msgspec.to_builtins(models)}
        header = header_of(
            f"talk in {self._scene.name}", told, models,
            rows=[self._row], tasks=[task], scenes={}, steps=True, kind="talk",
        )  # fmt: skip
        names = {"planner": self._given.model.name, "vision": self._given.vision.name}
        return header if self._models else replace(header, models=names)
