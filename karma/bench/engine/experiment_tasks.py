"""The tasks of an experiment, ours, the authors' or ALFRED's, and the rooms that they bring."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

from karma.agent.goals.files import load_tasks
from karma.bench.engine.experiment import Experiment
from karma.bench.engine.experiment_file import is_called, meant_path
from karma.bench.tasks.alfred import alfred_tasks
from karma.bench.tasks.authors import load_authors_tasks
from karma.bench.tasks.days import check_seeds
from karma.contracts import SceneRef, Task
from karma.errors import FileError, KarmaError
from karma.files import below, read_bytes, to_json
from karma.world.importing.scenes import import_dump

_NAMED = 50  # tasks in an error message


class _Listed(Protocol):
    @property
    def id(self) -> str:
        """Names a task."""


T = TypeVar("T", bound=_Listed)


class Loaded(NamedTuple):
    """The tasks of an experiment, and the rooms that they bring along."""

    tasks: tuple[Task, ...]
    scenes: Mapping[str, bytes]  # name -> content of its file; where they belong, tasks say


def load(experiment: Experiment, path: Path) -> Loaded:
    """Load the tasks that an experiment selects; `path` is named in messages.

    Raises:
        FileError: the task file is damaged, or a task of `only` is not in it.
        KarmaError: a task has no start for one of the seeds.
    """
    given = (experiment.tasks, experiment.authors, experiment.alfred)
    if sum(map(bool, given)) != 1:
        raise FileError(path, "give one of `tasks`, `authors` and `alfred`")
    try:
        tasks, scenes = _loaded(experiment)
    except FileError as error:
        raise meant_path(path, error) from error
    chosen = select(tasks, experiment.only, path)[: experiment.limit]
    check_seeds(chosen, experiment.seeds)
    return Loaded(tasks=chosen, scenes=_brought(chosen, scenes))


def _loaded(experiment: Experiment) -> Loaded:
    if experiment.tasks:
        return Loaded(tasks=load_tasks(experiment.tasks), scenes={})
    if experiment.alfred:
        return Loaded(*alfred_tasks(experiment.alfred))
    return _authors_tasks(experiment)


def select(tasks: Sequence[T], only: Sequence[str], path: Path) -> tuple[T, ...]:
    """Return the tasks that an experiment is for, in their order.

    In an id of `only` "*" is any text; () is all. `path` is named in messages.

    Raises:
        FileError: there is no task of an id.
    """
    known = [task.id for task in tasks]
    if missing := [name for name in only if not any(is_called(one, name) for one in known)]:
        near = get_close_matches(missing[0], known, n=1)
        meant = f"did you mean {near[0]!r}? " if near else ""
        there = ", ".join(known[:_NAMED]) + (" ..." if len(known) > _NAMED else "")
        raise FileError(path, f"only: no task {missing[0]!r}; {meant}there are {there}")
    return tuple(
        task for task in tasks if not only or any(is_called(task.id, name) for name in only)
    )


def _brought(tasks: tuple[Task, ...], imported: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the rooms of some tasks that are none of ours.

    Raises:
        KarmaError: two rooms have one name: maps and records could not tell them apart.
    """
    found: dict[str, bytes] = {}
    rooms: dict[str, SceneRef] = {}
    for scene in dict.fromkeys(scene for task in tasks for scene in task.scenes):
        other = rooms.setdefault(scene.name, scene)
        if other != scene and not _alike(other, scene):
            raise KarmaError(
                f"two rooms have the name {scene.name!r}: {other.source} and {scene.source}\n"
                "  To fix: call one of the files otherwise"
            )
        if scene.name in imported:
            found[scene.name] = imported[scene.name]
        elif scene.path:
            found[scene.name] = read_bytes(scene.path)
    return found


def _alike(one: SceneRef, other: SceneRef) -> bool:
    """Return whether two files are one, or hold the same."""
    contents = {read_bytes(scene.path) if scene.path else b"" for scene in (one, other)}
    return len(contents) == 1


def scene_path(folder: Path, name: str) -> Path:
    """Return where an imported floor plan lies in a run folder; FileError if its name leaves it."""
    return below(folder / "scenes", f"{name}.json")


def _authors_tasks(experiment: Experiment) -> Loaded:
    """Load the authors' tasks and the floor plans they play in."""
    raw = load_authors_tasks([Path(path) for path in experiment.authors])
    plans = {task.scene.name for task in raw}
    layouts = Path(experiment.layouts) if experiment.layouts else None
    dump = import_dump(Path(experiment.scenes), layouts=layouts)
    scenes = {scene.name: scene for scene in dump if scene.name in plans}
    return Loaded(
        tasks=tuple(
            task
            if (name := task.scene.name) in scenes
            else replace(task, notes=(*task.notes, f"no dump of {name}"))
            for task in raw
        ),
        scenes={name: to_json(scene) for name, scene in scenes.items()},
    )
