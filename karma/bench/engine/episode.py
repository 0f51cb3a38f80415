"""One task, one method, one world -> one record; and where an episode begins.

Seed 0 is the scene as it is, any other seed is another day in it: at temperature 0 the same start
gives the same episode, so a seed has to change something real. Half of what can be carried lies
elsewhere, and the agent stands somewhere else. All rows of a task and seed begin alike. Nobody is
asked whether a start is easy enough. One is drawn again only while something is done in it before
it was asked for, and records say how often that was.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from karma.agent.seeing.perceive import cells_of, pose_of, refusal, truth_of
from karma.errors import FileError, KarmaError, UnwritableError
from karma.goals.goals import GoalTracker, WatchedWorld, object_names
from karma.household.uses import BIN
from karma.journal.entries import Enter
from karma.journal.records import EpisodeRecord, SubTaskRecord, untimed, waited
from karma.journal.steps import StepLog
from karma.journal.writer import EpisodeWriter, TimeLog, through
from karma.models.session import Cassette, CassetteError, Ledger, NoCassette
from karma.seeds import stream
from karma.types.memory import Tour
from karma.types.roles import Episode, Event, Method, World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.home import Home

_DRAWS = 20  # starts tried; then the one in which the least is done is taken
_SHARE = 2  # one in so many of the things that can be carried is moved
_SPARED = (BIN,)  # no day begins with things in the bin
_TURNS_DEG = (0.0, 90.0, 180.0, 270.0)


def check_seeds(tasks: Iterable[Task], seeds: Iterable[int]) -> None:
    """See that every task has a start for every seed.

    Raises:
        KarmaError: a sequence is to begin on another day; its requests were drawn for the scenes as
            they are.
    """
    other = [seed for seed in seeds if seed]
    alone = next((task.id for task in tasks if task.kind == "sequence"), "")
    if other and alone:
        raise KarmaError(
            f"seeds: {other[0]}: the sequence {alone!r} has no other days, only seed 0\n"
            "  To fix: seeds = [0], or more sequences in the task file"
        )


class Days:
    """Finds the start of each task and seed, and keeps which draw it was."""

    def __init__(self) -> None:
        self._draws: dict[tuple[Task, int], int] = {}
        self._usual: dict[Task, frozenset[int]] = {}

    def of(self, world: World, task: Task, seed: int) -> World:
        """Return a world in which every reset to the task's scene leads to the seed's start."""
        return DayWorld(world, task, seed, self) if seed else world

    def start(self, world: World, task: Task, seed: int) -> Event:
        """Bring a world into the start of a seed.

        Raises:
            KarmaError: the world refuses to move things.
        """
        if not seed:
            return world.reset(task.scene.source)
        return drawn(world, task, seed, self.draw(world, task, seed))

    def draw(self, world: World, task: Task, seed: int) -> int:
        """Return which draw the start of a seed is, from 0; where it is not known, search for it.

        The world is left in some draw.
        """
        if seed and (task, seed) not in self._draws:
            self._draws[task, seed] = self._search(world, task, seed)
        return self._draws.get((task, seed), 0)

    def _search(self, world: World, task: Task, seed: int) -> int:
        """Return the first draw in which no more is done than in the scene itself, or the best."""
        if task not in self._usual:
            self._usual[task] = done_already(task, world.reset(task.scene.source))
        counts = []
        for draw in range(_DRAWS):
            event = drawn(world, task, seed, draw)
            counts.append(len(done_already(task, event) - self._usual[task]))
            if not counts[-1]:
                break
        return counts.index(min(counts))


class DayWorld:
    """A world whose task's scene begins as one seed has it; else the world that it is given."""

    def __init__(self, world: World, task: Task, seed: int, days: Days) -> None:
        self._world, self._task, self._seed, self._days = world, task, seed, days

    @property
    def last_event(self) -> Event:
        """The world's own."""
        return self._world.last_event

    def reset(self, scene: str) -> Event:
        """Load a scene; the task's own is put into the seed's start."""
        if scene != self._task.scene.source:
            return self._world.reset(scene)
        return self._days.start(self._world, self._task, self._seed)

    def step(self, action: str, **arguments: Any) -> Event:
        """Do one action."""
        return self._world.step(action, **arguments)

    def stop(self) -> None:
        """Release what the world holds."""
        self._world.stop()


def drawn(world: World, task: Task, seed: int, draw: int) -> Event:
    """Reset a world to a task's scene, move things by lot, and put the agent on some cell.

    Things go where things are in the scene as it is, so that no more doors hide them than do.

    Raises:
        KarmaError: the world refuses to move things.
    """
    rng = stream(seed, "starts", task.id, str(draw))
    things = truth_of(world.reset(task.scene.source)).objects
    loose = sorted(thing.object_id for thing in things if thing.pickupable)
    types = {thing.object_id: thing.object_type for thing in things}
    in_use = {parent for t in things if t.pickupable for parent in t.parent_ids}
    event = world.step(
        "InitialRandomSpawn",
        randomSeed=int(rng.integers(1 << 30)),
        objectIds=[str(name) for name in rng.choice(loose, len(loose) // _SHARE, replace=False)],
        receptacleObjectIds=sorted(p for p in in_use if types.get(p) not in _SPARED),
        forceVisible=False,
        placeStationary=True,
    )
    if not event:
        raise KarmaError(f"{task.scene.name}: {refusal(event)}")
    return _stand(world, rng)


def _stand(world: World, rng: np.random.Generator) -> Event:
    """Put the agent on a cell and in a direction drawn by lot; it stays where none will do."""
    pose = pose_of(world.last_event)
    cells = cells_of(world.step("GetReachablePositions"))
    order = sorted(cells, key=lambda cell: (cell[0], cell[2]))
    for index in rng.permutation(len(order)):
        event = world.step(
            "TeleportFull",
            position=dict(zip("xyz", order[index], strict=True)),
            rotation={"x": 0.0, "y": float(rng.choice(_TURNS_DEG)), "z": 0.0},
            horizon=pose.horizon_deg,
            standing=pose.standing,
        )
        if event:
            return event
    return world.last_event


def done_already(task: Task, event: Event) -> frozenset[int]:
    """Return the sub-tasks, by number, that are met before anybody speaks of their things."""
    tracker = GoalTracker()
    tracker.start(event)
    spoken: set[str] = set()
    found = set()
    for number, subtask in enumerate(task.subtasks):
        names = {name for goal in subtask.goals for name in object_names(goal)}
        if subtask.goals and not names & spoken and not tracker.unmet(subtask.goals, event):
            found.add(number)
        spoken |= names
    return frozenset(found)


# ----------------------------------------------------------------- an episode


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
    ledger, cassette = ledger or Ledger(), cassette or NoCassette()
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
        steps.start(first)
        tracker.start(world.last_event)
        alone = task.kind == "sequence"  # every sub-task is a task by itself
        met = [] if alone else [_met(tracker, sub, world.last_event) for sub in task.subtasks]
        writer = EpisodeWriter(method.name, watched, tracker, ledger, cassette, steps, times, tours)
        for number, subtask in enumerate(task.subtasks):
            scene = subtask.scene or task.scene
            if alone:
                if home is not None and home.scene != scene.source:
                    home.enter(scene.source)
                    steps.add(Enter(scene=scene.name))
                    episode.enter(scene)
                tracker.start(watched.last_event)
                met.append(_met(tracker, subtask, world.last_event))
            events = episode.do(subtask)
            one = through(writer.write(number, subtask, scene.name, events))
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
