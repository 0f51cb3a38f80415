"""One task, one method, one world -> one record."""

from pathlib import Path

from karma.bench.records import Answer, Call, EpisodeRecord, SubTaskRecord
from karma.bench.tasks import required_types
from karma.contracts import MemoryUnit, Method, Outcome, Plan, SkillResult, SubTask, Task, World
from karma.errors import KarmaError
from karma.goals import GoalTracker, WatchedWorld
from karma.infer.cassette import Cassette, CassetteError
from karma.infer.hosted_cost import Ledger
from karma.prompt import base_type


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
) -> EpisodeRecord:
    """Run a task to its end; an error ends it early and is recorded.

    Args:
        method: who acts.
        world: where; reset to the task's scene here.
        task: what; goals are checked when each sub-task ends.
        row: name of the table's row.
        seed: of the episode.
        folder: takes what the method leaves behind.
        ledger: what hosted models cost.
        cassette: keeps what is measured in a run that can be replayed.

    Raises:
        CassetteError: a replay left its recording, or the recording cannot be written.
    """
    ledger, cassette = ledger or Ledger(), cassette or Cassette()
    cassette.begin(f"{row}/{task.id}/{seed}")
    tracker = GoalTracker()
    done: list[SubTaskRecord] = []
    error = ""
    try:
        world.reset(task.scene)
        watched = WatchedWorld(world, tracker)
        method.begin(watched, task.scene, seed=seed, folder=folder)
        tracker.start(world.last_event)
        for subtask in task.subtasks:
            done.append(
                _run_subtask(method, watched, tracker, subtask, ledger=ledger, cassette=cassette)
            )
    except CassetteError:
        raise
    except KarmaError as failure:
        error = f"{type(failure).__name__}: {failure}"
    return EpisodeRecord(
        row=row,
        task=task.id,
        kind=task.kind,
        scene=Path(task.scene).stem,
        seed=seed,
        notes=task.notes,
        subtasks=tuple(done),
        error=error,
        hosted=ledger.take(),
    )


def _run_subtask(
    method: Method,
    world: World,
    tracker: GoalTracker,
    subtask: SubTask,
    *,
    ledger: Ledger,
    cassette: Cassette,
) -> SubTaskRecord:
    tracker.begin_subtask()
    plans: list[Plan] = []
    results: list[SkillResult] = []
    outcome: Outcome | None = None
    begun = cassette.clock()
    for moment in method.do(subtask):
        if isinstance(moment, Plan):
            plans.append(moment)
        elif isinstance(moment, SkillResult):
            results.append(moment)
        else:
            outcome = moment
    seconds = cassette.clock() - begun
    if outcome is None:
        raise KarmaError(f"{method.name} ended an instruction without an outcome")
    wanted = required_types(subtask)
    return SubTaskRecord(
        instruction=subtask.instruction,
        goals=tuple(str(goal) for goal in subtask.goals),
        unmet=tuple(str(goal) for goal in tracker.unmet(subtask.goals, world.last_event)),
        finished=outcome.finished,
        answers=tuple(_answer(plan, cassette) for plan in plans),
        calls=tuple(Call.of(result) for result in results),
        recalled=tuple(unit.object_id for unit in plans[0].recalled) if plans else (),
        queries=len(wanted),
        hits=sum(_resident(name, outcome.resident) for name in wanted),
        seconds=seconds,
        hosted=ledger.take(),
    )


def _resident(name: str, units: tuple[MemoryUnit, ...]) -> bool:
    return any(base_type(unit.object_type) == base_type(name) for unit in units)


def _answer(plan: Plan, cassette: Cassette) -> Answer:
    said = plan.completion
    first = said.first_token_s
    return Answer(
        program=said.text,
        error=plan.error,
        finish=said.finish,
        prompt_tokens=said.prompt_tokens,
        reused_tokens=said.reused_tokens,
        completion_tokens=said.completion_tokens,
        first_token_s=None if first is None else cassette.measured(first),
        total_s=cassette.measured(said.total_s),
        threads=said.threads,
        batch=said.batch,
        cost=said.cost,
    )
