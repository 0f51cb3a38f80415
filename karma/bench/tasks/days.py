"""Where an episode begins: seed 0 is the scene as it is, any other seed is another day in it.

At temperature 0 the same start gives the same episode, so a seed has to change something real: half
of what can be carried lies elsewhere, and the agent stands somewhere else. All rows of a task and
seed begin alike. Nobody is asked whether a start is easy enough. One is drawn again only while
something is done in it before it was asked for, and records say how often that was.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from karma.agent.goals.goals import GoalTracker, object_names
from karma.agent.seeing.perceive import cells_of, pose_of, refusal, truth_of
from karma.contracts import Event, Task, World
from karma.errors import KarmaError
from karma.household.uses import BIN
from karma.seeds import stream

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
