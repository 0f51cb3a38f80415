"""One instruction of an episode or a conversation: carried out, logged, and added up."""

from collections.abc import Generator
from dataclasses import dataclass

from karma.agent.goals.files import required_types
from karma.agent.goals.goals import GoalTracker
from karma.agent.journal.records import (
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
from karma.agent.journal.steps import Enter, StepLog
from karma.contracts import (
    Episode,
    Outcome,
    Plan,
    SceneRef,
    SkillResult,
    SubTask,
    Tour,
    World,
)
from karma.errors import KarmaError
from karma.household.pieces import base_type
from karma.models.session import Cassette, Ledger
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


Moments = Generator[Plan | SkillResult | Outcome, None, SubTaskRecord]  # of one instruction


def through(moments: Moments) -> SubTaskRecord:
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
        wanted = [base_type(name) for name in required_types(subtask)]
        units = (unit for unit in outcome.resident if unit.scene in ("", room))
        here = {base_type(unit.object_type) for unit in units}
        return SubTaskRecord(
            instruction=subtask.instruction,
            goals=tuple(str(goal) for goal in subtask.goals),
            unmet=unmet,
            finished=outcome.finished,
            answers=tuple(Answer.of(plan) for plan in plans),
            calls=tuple(Call.of(result) for result in results),
            recalled=tuple(unit.object_id for unit in plans[0].units) if plans else (),
            queries=len(wanted),
            hits=sum(name in here for name in wanted),
            hosted=untimed(spent),
        )


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
