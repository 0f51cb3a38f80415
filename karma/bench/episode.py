"""One task, one method, one world -> one record."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path

from karma.bench.days import Days, check_seeds
from karma.bench.records import (
    Answer,
    AnswerTiming,
    Call,
    EpisodeRecord,
    EpisodeTiming,
    SubTaskRecord,
    SubTaskTiming,
    untimed,
    waited,
)
from karma.bench.steps import Enter, LoggedWorld, StepLog
from karma.contracts import (
    Episode,
    Event,
    MemoryUnit,
    Method,
    Outcome,
    Plan,
    SceneRef,
    SkillResult,
    SubTask,
    Task,
    Tour,
    World,
)
from karma.errors import FileError, KarmaError, UnwritableError
from karma.household.pieces import base_type
from karma.infer.hosted.cassette import Cassette, CassetteError
from karma.infer.hosted.cost import Ledger
from karma.tasks.files import required_types
from karma.tasks.goals import GoalTracker, WatchedWorld
from karma.world.home import Home


class TimeLog:
    """Collects what an episode took."""

    def __init__(self) -> None:
        self.subtasks: list[SubTaskTiming] = []
        self.hosted_s: tuple[float, ...] = ()

    def of(self, record: EpisodeRecord) -> EpisodeTiming:
        """Return the timing that belongs to the episode's record."""
        return EpisodeTiming(
            row=record.row,
            task=record.task,
            seed=record.seed,
            subtasks=tuple(self.subtasks),
            hosted_s=self.hosted_s,
        )


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

    Args:
        method: who acts.
        world: where; reset to the task's scene here. A task of several rooms takes a `Home`.
        task: what; goals are checked when each sub-task ends.
        row: name of the table's row.
        seed: of the episode.
        folder: takes what the method leaves behind.
        ledger: what hosted models cost.
        cassette: keeps what is measured in a run that can be replayed.
        steps: takes what happens.
        times: takes what it took.
        days: finds what the seed stands for; shared by a run's episodes it searches once.

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
        world = days.of(LoggedWorld(world, steps), task, seed)
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
            one = _through(part.carry_out(number, subtask, scene.name))
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


Moments = Generator[Plan | SkillResult | Outcome, None, SubTaskRecord]  # of one instruction


def _through(moments: Moments) -> SubTaskRecord:
    """Go through an instruction that nobody watches."""
    while True:
        try:
            next(moments)
        except StopIteration as end:
            record: SubTaskRecord = end.value
            return record


@dataclass(frozen=True, slots=True)
class EpisodePart:
    """What the instructions of one episode share."""

    method: str  # its name
    episode: Episode
    world: World
    tracker: GoalTracker
    ledger: Ledger
    cassette: Cassette
    steps: StepLog
    times: TimeLog
    tours: dict[str, Tour]  # takes by room what made the maps that were used

    def go(self, home: Home | None, scene: SceneRef) -> None:
        """Be in a room for a task by itself: what earlier ones brought about does not count."""
        if home is not None and home.scene != scene.source:
            home.enter(scene.source)
            self.steps.add(Enter(scene=scene.name))
            self.episode.enter(scene)
        self.tracker.start(self.world.last_event)

    def carry_out(self, number: int, subtask: SubTask, room: str) -> Moments:
        """Carry out one instruction: yields what happens, returns its record."""
        self.tracker.begin_subtask(subtask, self.world.last_event)
        self.steps.instruction(number, subtask)
        plans: list[Plan] = []
        results: list[SkillResult] = []
        outcome: Outcome | None = None
        begun = self.cassette.clock()
        for moment in self.episode.do(subtask):
            if isinstance(moment, Outcome):
                outcome = moment
                continue
            self.steps.moment(moment)
            if isinstance(moment, Plan):
                plans.append(moment)
            else:
                results.append(moment)
            yield moment
        seconds = self.cassette.clock() - begun
        if outcome is None:
            raise KarmaError(f"{self.method} ended an instruction without an outcome")
        unmet = tuple(str(g) for g in self.tracker.unmet(subtask.goals, self.world.last_event))
        self.steps.outcome(outcome, unmet)
        if outcome.tour is not None:
            self.tours.setdefault(room, outcome.tour)
        spent = self.ledger.take()
        self.times.subtasks.append(
            SubTaskTiming(
                seconds=seconds,
                answers=tuple(_timing(plan, self.cassette) for plan in plans),
                hosted_s=waited(spent),
            )
        )
        yield outcome
        wanted = required_types(subtask)
        here = tuple(unit for unit in outcome.resident if unit.scene in ("", room))
        return SubTaskRecord(
            instruction=subtask.instruction,
            goals=tuple(str(goal) for goal in subtask.goals),
            unmet=unmet,
            finished=outcome.finished,
            answers=tuple(Answer.of(plan) for plan in plans),
            calls=tuple(Call.of(result) for result in results),
            recalled=tuple(unit.object_id for unit in plans[0].units) if plans else (),
            queries=len(wanted),
            hits=sum(_resident(name, here) for name in wanted),
            hosted=untimed(spent),
        )


def _resident(name: str, units: tuple[MemoryUnit, ...]) -> bool:
    return any(base_type(unit.object_type) == base_type(name) for unit in units)


def _timing(plan: Plan, cassette: Cassette) -> AnswerTiming:
    said = plan.completion
    first = said.first_token_s
    return AnswerTiming(
        first_token_s=None if first is None else cassette.measured(first),
        total_s=cassette.measured(said.total_s),
        reused_tokens=said.reused_tokens,
        state=said.state,
        engine=said.engine,
    )
