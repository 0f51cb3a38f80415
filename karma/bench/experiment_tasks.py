"""The tasks of an experiment, ours, the authors' or ALFRED's, and the rooms that they bring."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec

from karma.bench.alfred_tasks import AlfredTasks, alfred_tasks
from karma.bench.days import check_seeds
from karma.bench.experiment import Experiment
from karma.contracts import SceneRef, Task
from karma.errors import FileError
from karma.files import read_bytes, to_json
from karma.tasks.authors import load_authors_tasks, resolve
from karma.tasks.files import in_rooms, load_tasks
from karma.world.core.scene import Scene
from karma.world.importing.scenes import import_dump

_NAMED = 50  # tasks in an error message


class _Listed(Protocol):
    @property
    def id(self) -> str:
        """Names a task."""


T = TypeVar("T", bound=_Listed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """The tasks of an experiment, and the rooms that they bring along."""

    tasks: tuple[Task, ...]
    scenes: Mapping[str, bytes]  # name -> content of its file; where they belong, tasks say


def load(experiment: Experiment, path: Path, folder: Path) -> Loaded:
    """Load the tasks that an experiment selects; nothing is written.

    Args:
        experiment: what was read.
        path: from where, for messages.
        folder: of the run, below which imported floor plans will lie.

    Raises:
        FileError: the task file is damaged, or a task of `only` is not in it.
        KarmaError: a task has no start for one of the seeds.
    """
    given = (experiment.tasks, experiment.authors, experiment.alfred)
    if sum(map(bool, given)) != 1:
        raise FileError(path, "give one of `tasks`, `authors` and `alfred`")
    if experiment.tasks:
        loaded = Loaded(tasks=load_tasks(experiment.tasks), scenes={})
    elif experiment.alfred:
        loaded = _alfred_tasks(experiment.alfred, folder)
    else:
        loaded = _authors_tasks(experiment, folder)
    chosen = select(loaded.tasks, experiment.only, path)
    check_seeds(chosen, experiment.seeds)
    return Loaded(tasks=chosen, scenes=_brought(chosen, loaded.scenes))


def select(tasks: Sequence[T], only: Sequence[str], path: Path) -> tuple[T, ...]:
    """Return the tasks that an experiment is for, in their order.

    Args:
        tasks: all.
        only: ids of those that are wanted; () = all.
        path: of the experiment, for messages.

    Raises:
        FileError: there is no task of an id.
    """
    known = [task.id for task in tasks]
    if missing := [name for name in only if name not in known]:
        near = get_close_matches(missing[0], known, n=1)
        meant = f"did you mean {near[0]!r}? " if near else ""
        there = ", ".join(known[:_NAMED]) + (" ..." if len(known) > _NAMED else "")
        raise FileError(path, f"only: no task {missing[0]!r}; {meant}there are {there}")
    return tuple(task for task in tasks if not only or task.id in only)


def _brought(tasks: tuple[Task, ...], imported: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the rooms of some tasks that are none of ours."""
    found = {}
    for scene in dict.fromkeys(scene for task in tasks for scene in task.scenes):
        if scene.name in imported:
            found[scene.name] = imported[scene.name]
        elif scene.path:
            found[scene.name] = read_bytes(scene.path)
    return found


def scene_path(folder: Path, name: str) -> Path:
    """Return where an imported floor plan lies in a run folder."""
    return folder / "scenes" / f"{name}.json"


def _alfred_tasks(source: AlfredTasks, folder: Path) -> Loaded:
    """Load ALFRED's tasks and the rooms of their trials."""
    paths = {name: getattr(source, name) for name in ("trials", "lists", "training")}
    found = {name: str(beside(given)) if given else "" for name, given in paths.items()}
    tasks, scenes = alfred_tasks(msgspec.structs.replace(source, **found))

    def placed(scene: SceneRef) -> SceneRef:
        known = scene.name in scenes
        return replace(scene, path=str(scene_path(folder, scene.name))) if known else scene

    return Loaded(tasks=tuple(in_rooms(task, placed) for task in tasks), scenes=scenes)


def _authors_tasks(experiment: Experiment, folder: Path) -> Loaded:
    """Load the authors' tasks and the floor plans they play in."""
    raw = load_authors_tasks([beside(path) for path in experiment.authors])
    plans = {task.scene.name for task in raw}
    layouts = beside(experiment.layouts) if experiment.layouts else None
    dump = import_dump(beside(experiment.scenes), layouts=layouts)
    scenes = {scene.name: scene for scene in dump if scene.name in plans}
    return Loaded(
        tasks=tuple(_in_scene(task, scenes, folder) for task in raw),
        scenes={name: to_json(scene) for name, scene in scenes.items()},
    )


def _in_scene(task: Task, scenes: Mapping[str, Scene], folder: Path) -> Task:
    name = task.scene.name
    scene = scenes.get(name)
    if scene is None:
        return replace(task, notes=(*task.notes, f"no dump of {name}"))
    found = resolve(task, [thing.type for thing in scene.objects])
    return replace(found, scene=SceneRef(name=name, path=str(scene_path(folder, name))))


def beside(path: str) -> Path:
    """Return a path, with $KARMA_SHARED in place of "../shared" where that is set."""
    shared = os.environ.get("KARMA_SHARED")
    inside = path.removeprefix("../shared/")
    return Path(shared) / inside if shared and inside != path else Path(path)
