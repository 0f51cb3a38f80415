"""Our tasks as a run does them: every row on every task, with models that are loaded once."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from karma import registry
from karma.agent.tour import explore_room
from karma.bench.engine.episode import Days, run_episode
from karma.bench.engine.experiment import Experiment, load, scene_path
from karma.bench.engine.experiment_file import Changes, read_experiment
from karma.bench.engine.suite import Chain, Done
from karma.bench.figures.columns import added_up
from karma.errors import FileError, KarmaError
from karma.files import inside
from karma.goals.files import in_rooms
from karma.journal.folder import RESULTS
from karma.journal.header import Header, Options
from karma.journal.provenance import header_of
from karma.journal.records import EpisodeRecord
from karma.journal.run_folder import Finished, RunFolder
from karma.journal.steps import StepLog
from karma.journal.writer import TimeLog
from karma.loading.models import (
    Models,
    Row,
    for_row,
    load_resources,
    preset,
    world_maker,
)
from karma.loading.planner_files import may_refuse
from karma.models.manifest import resolve_planner
from karma.models.session import Session
from karma.offline.guard import settle
from karma.types.roles import Method, Resources, VisionModel, World
from karma.types.space import SceneRef
from karma.types.tasks import Task
from karma.world.home import Home

MAPS = "maps"  # below the run folder


@dataclass(frozen=True, slots=True, kw_only=True)
class OurTasks:
    """An experiment of ours, see `Suite`."""

    experiment: Experiment  # as its file and the command say it
    models: Models
    tasks: tuple[Task, ...]
    scenes: Mapping[str, bytes]  # that the tasks bring along, by name
    folder: Path  # of the run, on the machine that does the episodes, for maps and pictures
    steps: bool

    @property
    def rows(self) -> tuple[Row, ...]:
        """Those that act."""
        return self.experiment.rows

    @property
    def header(self) -> Header:
        """What records depend on; errors as `configuration`."""
        one = self.experiment
        return header_of(
            one.name, configuration(one), one.models,
            rows=one.rows, tasks=self.tasks, scenes=self.scenes, steps=self.steps,
        )  # fmt: skip

    def files(self, folder: Path) -> RunFolder:
        """Return the folder as what takes what episodes leave."""
        return RunFolder(folder, steps=self.steps)

    def brought(self) -> dict[str, bytes]:
        """Return the rooms that tasks bring along by their place below the folder."""
        return {
            scene_path(self.folder, name).relative_to(self.folder).as_posix(): data
            for name, data in self.scenes.items()
        }

    def placed(self) -> tuple[Task, ...]:
        """Return the tasks with the rooms that they bring along where the folder has them."""

        def place(scene: SceneRef) -> SceneRef:
            if scene.name not in self.scenes:
                return scene
            return replace(scene, path=str(scene_path(self.folder, scene.name)))

        return tuple(in_rooms(task, place) for task in self.tasks)

    def chains(self, seeds: Sequence[int]) -> list[Chain]:
        """Return all episodes in their final order, each by itself."""
        return [
            Chain(row=row.name, tasks=(task.id,), seed=seed)
            for seed in seeds
            for row in self.rows
            for task in self.tasks
        ]

    def added_up(self, records: Sequence[EpisodeRecord]) -> dict[str, bytes]:
        """Return what records come to, by the name of its file."""
        return {RESULTS: added_up(records)}

    def begin(self, session: Session) -> Callable[[Chain], Iterator[Done]]:
        """Load what episodes need.

        Raises:
            KarmaError: a model cannot be loaded, or a row has an option that its method does not
                know.
        """
        return Performer(self, session).play


def our_tasks(
    path: Path,
    changes: Changes | None,
    computed: Mapping[str, Any],
    base_url: str,
    *,
    folder: Path,
    steps: bool,
) -> OurTasks:
    """Read an experiment and its tasks; arguments and errors as of `karma.bench.engine.run.Run`."""
    experiment = read_experiment(path, changes)
    models = experiment.models.computed_by(computed)
    experiment = msgspec.structs.replace(experiment, models=models)
    if base_url:  # where it is asked is no part of what a run depends on
        models = msgspec.structs.replace(models, hosted=models.hosted.at(base_url))
    found = load(experiment, path)
    return OurTasks(
        experiment=experiment,
        models=models,
        tasks=found.tasks,
        scenes=found.scenes,
        folder=folder,
        steps=steps,
    )


class Performer:
    """Does episodes, one after the other, with models that are loaded once.

    Raises:
        KarmaError: a model cannot be loaded, or a row has an option that its method does not know.
    """

    def __init__(self, suite: OurTasks, session: Session) -> None:
        self._suite, self._session = suite, session
        self._tasks = {task.id: task for task in suite.placed()}
        self._maps = suite.folder / MAPS
        resources = load_resources(
            suite.models,
            maps=inside(suite.folder, MAPS),
            seed=suite.experiment.seeds[0],  # of the planner's decoding
            session=session,
        )
        world = suite.experiment.world
        self._make = world_maker(world, [row.all_options for row in suite.rows])
        self._world = self._make()
        self._days = Days()
        seeing = {suite.models.vision: resources.vision}
        self._methods = {  # all of them now: a wrong row must not come to light hours later
            row.name: _built(row, resources, seeing, suite.models) for row in suite.rows
        }
        session.ledger.take()  # what loading asked is on no episode's bill

    def play(self, chain: Chain) -> Iterator[Finished]:
        """Do each episode of a chain, when it is asked for."""
        for task in chain.tasks:
            yield self._done(chain.row, self._tasks[task], chain.seed)

    def _done(self, row: str, task: Task, seed: int) -> Finished:
        if seed:
            for scene in task.scenes:
                self._know(scene)
        steps, times, logged = StepLog(), TimeLog(), self._suite.steps
        with self._worlds(task) as world:
            record = run_episode(
                self._methods[row],
                world,
                task,
                row=row,
                seed=seed,
                folder=self._suite.folder,
                ledger=self._session.ledger,
                cassette=self._session.cassette,
                steps=steps if logged else None,
                times=times,
                days=self._days,
            )
        settle()
        data = steps.data() if logged else b""
        return Finished(record=record, timing=times.of(record), steps=data)

    @contextmanager
    def _worlds(self, task: Task) -> Iterator[World]:
        """Give the world of a task: a home, for as long as it is needed, where it has rooms."""
        if len(task.scenes) == 1:
            yield self._world
            return
        home = Home(self._make)
        try:
            yield home
        finally:
            home.stop()

    def _know(self, scene: SceneRef) -> None:
        """Have a map of a room as it is, before somebody makes one of it on another day."""
        path = inside(self._suite.folder, f"{MAPS}/{scene.name}.json")
        if path.exists():
            return
        try:
            self._world.reset(scene.source)
            graph, _ = explore_room(self._world, scene, None)
        except FileError:  # the episode will say why
            return
        graph.save(path)


def _built(
    row: Row, resources: Resources, loaded: dict[str, VisionModel], models: Models
) -> Method:
    """Return the method of a row.

    Raises:
        KarmaError: it has an option that the method does not know, or of the wrong type.
    """
    try:
        kind: type[Method] = registry.load("methods", row.method)
        return kind.build(for_row(resources, row, loaded, models), row.all_options)
    except KarmaError as error:
        raise KarmaError(f"row {row.name!r}: {error}") from error


def configuration(experiment: Experiment) -> Options:
    """Return all that an experiment says, with what it leaves to presets, models and methods.

    Raises:
        ModelError: a model's file is missing.
        UnknownNameError: there is no such model, or method.
    """
    plain: dict[str, Any] = msgspec.to_builtins(experiment)
    plain["models"] |= _settled(experiment.models)
    for row, said in zip(experiment.rows, plain["rows"], strict=True):
        said |= _row(row, experiment.models)
    return plain


def _settled(models: Models) -> dict[str, Any]:
    """Return what is left to the planner's own entry."""
    if models.hosted.planner is not None:
        return {"profile": models.profile or "full", "refusing": bool(models.refusing)}
    file = resolve_planner(models.planner)
    return {
        "profile": models.profile or file.prompt_profile,
        "chat": file.chat if models.chat is None else models.chat,
        "refusing": may_refuse(models.planner, models.refusing),
    }


def _row(row: Row, models: Models) -> dict[str, Any]:
    """Return what a row leaves to its preset, its method and [models]."""
    own = preset(row.preset).recall if row.preset else models.recall
    kind = getattr(registry.load("methods", row.method), "settings_kind", None)
    defaults = {} if kind is None else msgspec.to_builtins(kind())
    return {
        "recall": row.recall or own,
        "vision": row.vision or models.vision,
        "options": {**defaults, **row.all_options},
    }
