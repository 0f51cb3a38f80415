"""A conversation as a run's folder: one episode of what was said, opened by `karma report`.

The same records, step log and header as an experiment's; nobody judges it, as it has no goals.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from karma.bench.episode import TimeLog
from karma.bench.experiment import Experiment, Models, Row
from karma.bench.provenance import header_of
from karma.bench.records import EpisodeRecord, SubTaskRecord
from karma.bench.run_folder import Finished, Header, RunFolder
from karma.bench.steps import StepLog
from karma.contracts import Resources, SceneRef, SubTask, Task, Tour
from karma.errors import FileError

TALKS = Path("runs/talks")
SAID = "said"  # the task, and its kind


def next_folder(scene: str, talks: Path = TALKS) -> Path:
    """Return the next folder that is free: `kitchen_1-1`, then `kitchen_1-2`."""
    number = 1
    while (talks / f"{scene}-{number}").exists():
        number += 1
    return talks / f"{scene}-{number}"


class Keeper:
    """Writes a conversation into its folder, whole each time.

    Args:
        folder: of the run; made at the first writing.
        scene: where.
        row: name and options of the agent.
        models: that were loaded by name; None where they were given.
        given: resources that were handed over, instead.
    """

    def __init__(
        self, folder: Path, scene: SceneRef, row: Row, models: Models | None, given: Resources
    ) -> None:
        self.folder, self._scene, self._row = folder, scene, row
        self._models, self._given = models, given

    def write(
        self,
        done: Iterable[SubTaskRecord],
        *,
        method: str,
        steps: StepLog,
        times: TimeLog,
        tours: Iterable[Tour],
        maps: Mapping[str, bytes],
    ) -> None:
        """Write all that was said so far.

        Raises:
            FileError: the folder cannot be written.
        """
        subtasks = tuple(done)
        record = EpisodeRecord(
            row=self._row.name,
            method=method,
            task=SAID,
            kind=SAID,
            scene=self._scene.name,
            seed=0,
            notes=(),
            subtasks=subtasks,
            unjudged="nobody judges what was said",
            tours=tuple(tours),
        )
        files = {f"maps/{name}.json": data for name, data in maps.items()}
        finished = Finished(record=record, timing=times.of(record), steps=steps.data(), files=files)
        header = self._header(subtasks)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = f"cannot be made: {error.strerror}"
            raise FileError(self.folder, reason, fix="--out another folder") from error
        RunFolder(self.folder, steps=True).put_only(header, finished)

    def _header(self, done: Iterable[SubTaskRecord]) -> Header:
        said = tuple(SubTask(instruction=one.instruction) for one in done)
        task = Task(id=SAID, kind="sequence", scene=self._scene, subtasks=said, group=SAID)
        experiment = Experiment(
            name=f"talk in {self._scene.name}", rows=(self._row,), models=self._models or Models()
        )
        header = header_of(experiment, (task,), {}, steps=True)
        return header if self._models else replace(header, models=self._given_names())

    def _given_names(self) -> dict[str, str]:
        """Return what models call themselves that were not loaded by name."""
        return {"planner": self._given.model.name, "vision": self._given.vision.name}
