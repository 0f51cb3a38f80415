"""ALFWorld-R as episodes: sequences of tasks, each of which can be done when its turn comes.

Tasks are drawn as access traces draw theirs. The expert does one after the other in the
embedded world; what is done already at that point, or what it cannot do, is drawn anew, and has
never happened: moments of that world do not change, so going back costs nothing and is exact.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from karma.contracts import Goal, SceneRef, SubTask, Task
from karma.errors import KarmaError
from karma.household.types import object_type
from karma.household.uses import BASIN_OF
from karma.lab.tasks import Errand, Pool
from karma.lab.workloads import TRIES, Draws, Workload, draws
from karma.methods.expert import ExpertEpisode
from karma.seeds import stream
from karma.tasks.files import check_goal
from karma.tasks.goals import GoalTracker, WatchedWorld, alternatives, object_names
from karma.world.core.scene import Scene
from karma.world.event import WorldEvent
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

NO_GOALS = "nobody says what is to be done"
NO_ROOM = "its room is not there"
NO_SENSE = "AI2-THOR 5.0.0 does not allow it"  # to put such a thing there, or has no such type
NOT_THERE = "not in its room"
DONE = "done already"
TOO_HARD = "the expert cannot"
FRUITLESS = 200 * TRIES  # draws in a row that come to nothing, until the home is given up


@dataclass(frozen=True, slots=True, kw_only=True)
class Askable:
    """Tasks that can be asked for, and the rooms to do so.

    Args:
        pool: tasks with goals, in rooms that are there.
        rooms: name -> room.
        scenes: name -> the room as a task file names it.
        left_out: why tasks of the pool are none, and how many.
    """

    pool: Pool
    rooms: Mapping[str, Scene]
    scenes: Mapping[str, SceneRef]
    left_out: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnSequence:
    """One sequence, and what was drawn on the way to it."""

    workload: Workload
    task: Task
    kinds: tuple[str, ...]  # of each sub-task
    anew: Mapping[str, int]  # why draws were refused, and how many


def askable(pool: Pool, rooms: Mapping[str, Scene], folder: Path | None = None) -> Askable:
    """Leave out what cannot be asked for in some rooms.

    Args:
        pool: of tasks.
        rooms: name -> room.
        folder: where the rooms' files are to lie; None = they are our own.

    Raises:
        KarmaError: nothing is left.
    """
    left_out: Counter[str] = Counter()
    kept = []
    for errand in pool.errands:
        reason = _flaw(errand, rooms)
        left_out[reason] += bool(reason)
        if not reason:
            kept.append(errand)
    if not kept:
        raise KarmaError(f"{pool.source}: no task can be asked for: {dict(+left_out)}")
    used = {errand.scene for errand in kept}
    return Askable(
        pool=replace(pool, errands=tuple(kept)),
        rooms={name: rooms[name] for name in sorted(used)},
        scenes={
            name: SceneRef(name=name, path=str(folder / f"{name}.json") if folder else "")
            for name in sorted(used)
        },
        left_out=dict(+left_out),
    )


def _flaw(errand: Errand, rooms: Mapping[str, Scene]) -> str:
    if not errand.goals or not errand.sentences:
        return NO_GOALS
    if not all(map(_sensible, errand.goals)):
        return NO_SENSE
    return "" if errand.scene in rooms else NO_ROOM


def _sensible(goal: Goal) -> bool:
    """Return whether the types are there, and a thing that is put somewhere fits what takes it."""
    placed = goal.predicate in ("ON", "INSIDE")
    place = BASIN_OF.get(goal.arguments[-1], goal.arguments[-1])  # a tub itself holds nothing
    try:
        check_goal(replace(goal, arguments=(goal.arguments[0], place)) if placed else goal)
    except KarmaError:
        return False
    return not placed or object_type(place).can("receptacle")


def draw_sequence(
    tasks: Askable,
    workload: Workload,
    length: int,
    seed: int,
    number: int,
    advance: Callable[[], object] = lambda: None,
) -> DrawnSequence:
    """Draw one sequence; a shorter one is the beginning of a longer one.

    Args:
        tasks: to draw from.
        workload: how.
        length: sub-tasks.
        seed: of all sequences.
        number: of this one.
        advance: called after each sub-task.

    Raises:
        KarmaError: the pool has no task in some kind of room, or the home runs out of things to do.
    """
    walk = Walk(tasks)
    drawn = draws(tasks.pool, workload, seed, number)
    wording = stream(seed, "lab", "wording", workload, str(number))
    subtasks: list[SubTask] = []
    rooms: list[SceneRef] = []
    kinds: list[str] = []
    anew: Counter[str] = Counter()
    for _ in range(length):
        errand = _next(drawn, walk, anew, taken=bool(subtasks))
        text = errand.sentences[int(wording.integers(len(errand.sentences)))]
        rooms.append(tasks.scenes[errand.scene])
        one = SubTask(instruction=text, whole=text, goals=errand.goals, scene=rooms[-1])
        subtasks.append(one)
        kinds.append(errand.kind)
        advance()
    task = Task(
        id=f"{workload}-{seed}-{number:02}",
        kind="sequence",
        scene=rooms[0],
        subtasks=tuple(subtasks),
    )
    return DrawnSequence(workload=workload, task=task, kinds=tuple(kinds), anew=dict(anew))


def _next(drawn: Draws, walk: "Walk", anew: Counter[str], *, taken: bool) -> Errand:
    """Return the next task that is done, having told the draw whether the last one was taken."""
    errand = drawn.send(True) if taken else next(drawn)
    for _ in range(FRUITLESS):
        reason = walk.refusal(errand)
        if not reason:
            return errand
        anew[reason] += 1
        errand = drawn.send(False)
    raise KarmaError(
        f"nothing more can be done in this home: {FRUITLESS} draws in a row came to nothing\n"
        f"  To fix: a shorter --length, another --seed, or --workload type, which has every room"
    )


# ----------------------------------------------------------------- walking along


class Walk:
    """The expert in a home, doing one task after the other as in an episode.

    Args:
        tasks: say what the rooms are.
    """

    def __init__(self, tasks: Askable) -> None:
        self._rooms = tasks.rooms
        self._worlds: list[_HomeRoom] = []
        self._tracker = GoalTracker()
        self._home = Home(self._make)
        self._watched = WatchedWorld(self._home, self._tracker)
        self._expert: ExpertEpisode | None = None  # None before the first room
        self._refused: dict[tuple[str, tuple[Goal, ...]], str] = {}  # as things are now

    @property
    def moments(self) -> Mapping[str, WorldEvent]:
        """How each room that was visited is now, by name."""
        return {room.name: room.last_event for room in self._worlds}

    def refusal(self, errand: Errand) -> str:
        """Do a task; return "" or why not, and then nothing has changed."""
        key = (errand.scene, errand.goals)
        if key not in self._refused:
            self._refused[key] = self._tried(errand)
        reason = self._refused[key]
        if not reason:
            self._refused = {key: DONE}  # nobody asks for the same twice running
        return reason

    def _tried(self, errand: Errand) -> str:
        if not _has(self._rooms[errand.scene], errand.goals):
            return NOT_THERE
        here = self._home.scene
        expert = deepcopy(self._expert, {id(self._watched): self._watched})
        before = self.moments
        try:
            expert = self._entered(expert, errand.scene)
            before = {**self.moments, **before}  # a room at its first visit
            reason = self._done(expert, errand)
        except KarmaError:
            reason = TOO_HARD
        if not reason:
            self._expert = expert
            return ""
        if not here:  # there was no beginning yet
            self._worlds.clear()
            self._home.stop()
            return reason
        for room in self._worlds:
            room.back_to(before[room.name])
        self._home.enter(here)
        return reason

    def _entered(self, expert: ExpertEpisode | None, scene: str) -> ExpertEpisode:
        """Return the expert in a room, where it begins if it is nowhere yet."""
        if expert is None:
            self._home.reset(scene)
            return ExpertEpisode(self._watched, SceneRef(name=scene))
        if scene != self._home.scene:
            self._home.enter(scene)
            expert.enter(SceneRef(name=scene))
        return expert

    def _done(self, expert: ExpertEpisode, errand: Errand) -> str:
        """Let the expert do a task in its room, and judge as an episode does."""
        event = self._home.last_event
        self._tracker.start(event)
        if not self._tracker.unmet(errand.goals, event):
            return DONE
        text = errand.sentences[0]
        for _ in expert.do(SubTask(instruction=text, whole=text, goals=errand.goals)):
            pass
        return TOO_HARD if self._tracker.unmet(errand.goals, self._home.last_event) else ""

    def _make(self) -> "_HomeRoom":
        self._worlds.append(_HomeRoom(self._rooms))
        return self._worlds[-1]


class _HomeRoom:
    """An embedded world that takes its room from those at hand, and can go back.

    Args:
        rooms: by name.
    """

    def __init__(self, rooms: Mapping[str, Scene]) -> None:
        self._rooms, self._world, self.name = rooms, EmbeddedWorld(), ""

    @property
    def last_event(self) -> WorldEvent:
        """The world's own."""
        return self._world.last_event

    def reset(self, scene: str) -> WorldEvent:
        """Load a room by its name."""
        self.name = scene
        return self._world.reset(self._rooms[scene])

    def step(self, action: str, **arguments: Any) -> WorldEvent:
        """Do one action."""
        return self._world.step(action, **arguments)

    def stop(self) -> None:
        """Forget the room."""
        self._world.stop()

    def back_to(self, event: WorldEvent) -> None:
        """Make an earlier event the last one."""
        self._world.back_to(event)


def _has(room: Scene, goals: Sequence[Goal]) -> bool:
    """Return whether a room had everything that goals name when it began, as often as they count.

    Of what is cut one is enough.
    """
    types = Counter(thing.type for thing in room.objects)
    cut = {goal.arguments[0] for goal in goals if goal.arguments[-1] == "sliced"}
    wanted = [
        (name, goal.count if not place and name not in cut else 1)
        for goal in goals
        for place, name in enumerate(object_names(goal))
    ]
    return all(sum(types[one] for one in alternatives(name)) >= count for name, count in wanted)
