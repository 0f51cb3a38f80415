"""Write the events of an episode into its step log, records and timing."""

from collections.abc import Generator, Iterable
from dataclasses import dataclass

from karma.errors import KarmaError
from karma.goals.files import required_types
from karma.goals.goals import GoalTracker
from karma.household.pieces import base_type
from karma.journal.entries import Answer, Call, Ended, Instruction
from karma.journal.records import (
    AnswerTiming,
    EpisodeRecord,
    EpisodeTiming,
    SubTaskRecord,
    SubTaskTiming,
    untimed,
    waited,
)
from karma.journal.steps import StepLog
from karma.models.session import Cassette, Ledger
from karma.types.completion import Completion
from karma.types.events import AgentEvent, Outcome, Plan
from karma.types.memory import Tour
from karma.types.roles import World
from karma.types.tasks import SubTask


class TimeLog:
    """The durations of an episode."""

    def __init__(self) -> None:
        self.subtasks: list[SubTaskTiming] = []
        self.hosted_s: tuple[float, ...] = ()

    def of(self, record: EpisodeRecord) -> EpisodeTiming:
        """Return the timing of the episode's record."""
        return EpisodeTiming(
            row=record.row,
            task=record.task,
            seed=record.seed,
            subtasks=tuple(self.subtasks),
            hosted_s=self.hosted_s,
        )


Written = Generator[AgentEvent, None, SubTaskRecord]


def through(events: Written) -> SubTaskRecord:
    """Consume the events of an instruction and return its record."""
    while True:
        try:
            next(events)
        except StopIteration as end:
            record: SubTaskRecord = end.value
            return record


@dataclass(frozen=True, slots=True)
class EpisodeWriter:
    """Writes the instructions of an episode."""

    method: str  # its name
    world: World
    tracker: GoalTracker
    ledger: Ledger
    cassette: Cassette
    steps: StepLog
    times: TimeLog
    tours: dict[str, Tour]  # receives the tour behind each map, by room

    def write(
        self, number: int, subtask: SubTask, room: str, events: Iterable[AgentEvent]
    ) -> Written:
        """Write an instruction while it is carried out; yield its events.

        Returns:
            The instruction's record.
        """
        self.tracker.begin_subtask(subtask, self.world.last_event)
        self.steps.add(Instruction(number=number, instruction=subtask.instruction))
        answers: list[Answer] = []
        completions: list[Completion] = []
        calls: list[Call] = []
        outcome: Outcome | None = None
        begun = self.cassette.clock()
        for event in events:
            if isinstance(event, Outcome):
                outcome = event
                continue
            if isinstance(event, Plan):
                self.steps.map(event.prompt.stable)
                answers.append(Answer.of(event))
                completions.append(event.completion)
                self.steps.add(answers[-1])
            else:
                calls.append(Call.of(event))
                self.steps.add(calls[-1])
            yield event
        seconds = self.cassette.clock() - begun
        if outcome is None:
            raise KarmaError(f"{self.method} ended an instruction without an outcome")
        unmet = tuple(str(g) for g in self.tracker.unmet(subtask.goals, self.world.last_event))
        self.steps.add(Ended.of(outcome, unmet))
        if outcome.tour is not None:
            self.tours.setdefault(room, outcome.tour)
        spent = self.ledger.take()
        self.times.subtasks.append(
            SubTaskTiming(
                seconds=seconds,
                answers=tuple(_timing(one, self.cassette) for one in completions),
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
            answers=tuple(answers),
            calls=tuple(calls),
            queries=len(wanted),
            hits=sum(name in here for name in wanted),
            hosted=untimed(spent),
        )


def _timing(completion: Completion, cassette: Cassette) -> AnswerTiming:
    first = completion.first_token_s
    return AnswerTiming(
        first_token_s=None if first is None else cassette.measured(first),
        total_s=cassette.measured(completion.total_s),
        reused_tokens=completion.reused_tokens,
        state=completion.state,
        engine=completion.engine,
    )
