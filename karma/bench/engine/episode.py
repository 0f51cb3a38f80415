"""One task, one method, one world -> one record."""

from dataclasses import replace
from pathlib import Path

from karma.agent.goals.goals import GoalTracker, WatchedWorld
from karma.agent.journal.part import EpisodePart, TimeLog, through
from karma.agent.journal.records import EpisodeRecord, SubTaskRecord, untimed, waited
from karma.agent.journal.steps import StepLog
from karma.bench.tasks.days import Days, check_seeds
from karma.contracts import (
    Episode,
    Event,
    Method,
    SceneRef,
    SubTask,
    Task,
    Tour,
    World,
)
from karma.errors import FileError, KarmaError, UnwritableError
from karma.infer.hosted.cassette import Cassette, CassetteError
from karma.infer.hosted.endpoint import Ledger
from karma.world.home import Home


def run_episode(
    method: Method,
    world: World,
    task: Task,
    *,
    row: str,
    seed: int,
    folder: Path,
    ledger: Ledger | None = None,
    cassette: Cassette | None = None,
    steps: StepLog | None = None,
    times: TimeLog | None = None,
    days: Days | None = None,
) -> EpisodeRecord:
    """Run a task to its end; an error of the agent's own ends it early and is recorded.

    The world is reset to the task's scene; a task of several rooms takes a `Home`. Goals are
    checked when each sub-task ends. The folder takes what the method leaves behind, `steps` what
    happens, `times` what it took. `days` finds what a seed stands for; shared by episodes it
    searches once.

    Raises:
        KarmaError: what is no agent's doing (see `karma.errors.KarmaError.agents_own`), e.g. the
            simulator or a server is lost, a file is missing or torn, the disk is full. Only that
            the room is missing of a task that nobody can be judged by is recorded.
        TypeError: the task has several rooms and the world is no home.
    """
    check_seeds((task,), (seed,))
    home = world if isinstance(world, Home) else None
    if len(task.scenes) > 1 and home is None:
        raise TypeError(f"{task.id}: {len(task.scenes)} rooms take a Home, not one world")
    ledger, cassette = ledger or Ledger(), cassette or Cassette()
    steps, times = steps or StepLog(), times or TimeLog()
    cassette.begin(f"{row}/{task.id}/{seed}")
    first = task.scenes[0].name
    tracker = GoalTracker()
    done: list[SubTaskRecord] = []
    tours: dict[str, Tour] = {}
    error, draw = "", 0
    try:
        days = days or Days()
        draw = days.draw(world, task, seed)
        world = days.of(WatchedWorld(world, steps), task, seed)
        watched = WatchedWorld(world, tracker)
        episode = _begun(method, watched, task.scenes, seed=seed, folder=folder)
        steps.start(first, seed)
        tracker.start(world.last_event)
        alone = task.kind == "sequence"  # every sub-task is a task by itself
        met = [] if alone else [_met(tracker, sub, world.last_event) for sub in task.subtasks]
        part = EpisodePart(
            method.name, episode, watched, tracker, ledger, cassette, steps, times, tours
        )
        for number, subtask in enumerate(task.subtasks):
            scene = subtask.scene or task.scene
            if alone:
                part.go(home, scene)
                met.append(_met(tracker, subtask, world.last_event))
            one = through(part.carry_out(number, subtask, scene.name))
            one = replace(one, at_start=met[number])
            done.append(one if scene.name == first else replace(one, scene=scene.name))
    except KarmaError as failure:
        if not (failure.agents_own or (_unjudged(task) and _no_room(failure))):
            raise
        error = f"{type(failure).__name__}: {failure}"
    spent = ledger.take()
    times.hosted_s = waited(spent)
    return EpisodeRecord(
        row=row,
        method=method.name,
        task=task.id,
        kind=task.counted_as,
        scene=first,
        seed=seed,
        notes=task.notes,
        trained=task.trained,
        subtasks=tuple(done),
        error=error,
        unjudged=_unjudged(task),
        draw=draw,
        hosted=untimed(spent),
        tours=tuple(tours.values()),
    )


def _unjudged(task: Task) -> str:
    """Return why nobody can be judged by a task; "" when it has a goal."""
    if any(subtask.goals for subtask in task.subtasks):
        return ""
    return "; ".join(task.notes) or "it has no goals"


def _no_room(failure: KarmaError) -> bool:
    """Return whether a room is not there; tasks that cannot be judged may name rooms of others."""
    return isinstance(failure, FileError) and not isinstance(
        failure, UnwritableError | CassetteError
    )


def _met(tracker: GoalTracker, subtask: SubTask, event: Event) -> tuple[str, ...]:
    """Return the goals of a sub-task that hold."""
    unmet = tracker.unmet(subtask.goals, event)
    return tuple(str(goal) for goal in subtask.goals if goal not in unmet)


def _begun(
    method: Method, world: World, scenes: tuple[SceneRef, ...], *, seed: int, folder: Path
) -> Episode:
    """Show a method all rooms once; afterwards they are as they were, and it is in the first."""
    first, *others = scenes
    world.reset(first.source)
    episode = method.begin(world, first, seed=seed, folder=folder)
    for scene in others:
        world.reset(scene.source)
        episode.enter(scene)
    if others:
        world.reset(first.source)
        episode.enter(first)
        for scene in (*others, first):
            world.reset(scene.source)
    return episode
