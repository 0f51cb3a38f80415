"""An experiment is a TOML file: tasks, models, and one row per method.

Its tasks are lines of a file, or those of a source that a plug-in brings, with their rooms.
"""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import msgspec

from karma import registry
from karma.bench.engine.episode import check_seeds
from karma.errors import FileError, KarmaError
from karma.files import below, read_bytes
from karma.goals.files import load_tasks
from karma.loading.models import Models, Row
from karma.types.space import SceneRef
from karma.types.tasks import Task

MOST_SEEDS = 10_000


def check_listed(
    rows: Sequence[str], seeds: Sequence[int], only: Sequence[str], settings: Sequence[str] = ()
) -> None:
    """Raise ValueError where an experiment has nothing to do, or names something twice."""
    listed: Sequence[object]
    for what, listed in (("rows", rows), ("seeds", seeds), ("only", only), ("settings", settings)):
        if twice := [one for one, times in Counter(listed).items() if times > 1]:
            raise ValueError(f"{what}: {twice[0]!r} stands twice")
    if not rows:
        raise ValueError("rows: there is none; an experiment has a [[rows]] or more")
    if len(seeds) > MOST_SEEDS:
        raise ValueError(f"seeds: {len(seeds)} are too many; {MOST_SEEDS} at most")
    if not seeds or min(seeds) < 0:
        raise ValueError(f"seeds = {list(seeds)}: one or more, each 0 or above")


class Experiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One table: every row on every task with every seed."""

    name: str
    rows: tuple[Row, ...]
    tasks: str = ""  # our JSONL
    source: dict[str, Any] = {}  # or `kind`, a name of karma.task_sources, and its options
    only: tuple[str, ...] = ()  # task ids, "*" is any text; () = all
    limit: int | None = None  # the first so many of them; None: all
    world: str = "embedded"
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        """Refuse what there is nothing to do for, or what would be done twice."""
        check_listed([row.name for row in self.rows], self.seeds, self.only)
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"limit = {self.limit}: 1 or more, or none")


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
    if bool(experiment.tasks) == bool(experiment.source):
        raise FileError(path, "give either `tasks` or [source]")
    try:
        tasks, scenes = _loaded(experiment)
    except FileError as error:
        raise meant_path(path, error) from error
    except ValueError as error:
        raise FileError(path, f"source: {error}") from error
    chosen = select(tasks, experiment.only, path)[: experiment.limit]
    check_seeds(chosen, experiment.seeds)
    return Loaded(tasks=chosen, scenes=_brought(chosen, scenes))


def _loaded(experiment: Experiment) -> Loaded:
    if experiment.tasks:
        return Loaded(tasks=load_tasks(experiment.tasks), scenes={})
    options = dict(experiment.source)
    return Loaded(*registry.load("task_sources", options.pop("kind", ""))(options))


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


def is_called(name: str, wanted: str) -> bool:
    """Return whether a name is the wanted one, in which "*" is any text and "?" any letter."""
    return name == wanted or fnmatchcase(name, wanted)


def meant_path(path: Path, error: FileError) -> FileError:
    """Return the error of a missing file with what helps if it lies below the working directory.

    `path` is the experiment's that names it.
    """
    said = os.path.relpath(error.path, path.parent.absolute())
    if error.path.exists() or said.startswith("..") or not Path(said).exists():
        return error
    fix = f"write {os.path.relpath(said, path.parent)!r}"
    return FileError(path, f"{said}: no {error.path}; paths are relative to this file", fix=fix)
