"""Play one episode of LoTa-Bench's ALFRED, and say what it came to."""

from dataclasses import dataclass

from karma.benchmarks.lota_alfred.experiment import LotaRow, type_of_task
from karma.benchmarks.lota_alfred.planner import GeneratedPlayer, LotaAnswer, ScoredPlayer
from karma.benchmarks.players import ChancePlayer, ExpertPlayer
from karma.benchmarks.trial_rooms import TrialRooms
from karma.contracts import LanguageModel, ScoringModel
from karma.errors import KarmaError
from karma.journal.not_run import NotRun
from karma.tasks.alfred_lists import ListedTask
from karma.world.eb_alfred.actions import ActionTypes
from karma.world.eb_alfred.environment import UNKNOWN, Environment, Step
from karma.world.eb_alfred.protocol import LOTA_ALFRED

LotaPlayer = ScoredPlayer | GeneratedPlayer | ExpertPlayer | ChancePlayer


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaRecord:
    """What an episode leaves behind; the same in every run of the same experiment."""

    row: str
    task: str
    kind: str  # type of task
    seed: int
    trial: str
    instruction: str
    success: bool  # the goal is met at the end
    end: str  # "done", "steps", "plan over", "empty plan", "error"
    failed: int  # skills, unknown ones too
    unknown: int  # skills that there are not
    calls: int  # of the planner, or of another player
    steps: tuple[Step, ...]
    answers: tuple[LotaAnswer, ...] = ()
    error: str = ""  # what ended the episode from outside


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaStage:
    """What all episodes share."""

    rooms: TrialRooms
    types: ActionTypes
    model: LanguageModel | None  # None where no row asks one
    scorer: ScoringModel | None  # the same, where a row has skills scored


def play(stage: LotaStage, row: LotaRow, task: ListedTask, seed: int) -> LotaRecord | NotRun:
    """Play an episode, if it can be begun; what a model could not be asked is in the record.

    Raises:
        KarmaError: what is no player's doing, e.g. a server is lost or the disk full.
    """
    instruction, missing = _asked(stage.rooms, task)
    if missing:
        return NotRun(row=row.name, task=task.id, seed=seed, reason=missing, alone=True)
    player = _player(stage, row, task, instruction, seed)
    calls, error = 0, ""
    trial = stage.rooms.trials[task.trial]
    facts = stage.rooms.facts[trial.scene.floor_plan]
    environment = Environment(trial, facts, stage.types, protocol=LOTA_ALFRED, strict=row.strict)
    try:
        while not environment.end:
            calls += 1
            _take_turn(environment, player)
    except KarmaError as problem:
        if not problem.agents_own:
            raise
        error = str(problem)
    answers = () if isinstance(player, ExpertPlayer | ChancePlayer) else tuple(player.answers)
    steps = tuple(environment.steps)
    return LotaRecord(
        row=row.name,
        task=task.id,
        kind=type_of_task(task),
        seed=seed,
        trial=task.trial,
        instruction=instruction,
        success=not error and environment.goal_met,
        end="error" if error else environment.end,
        failed=sum(not step.ok for step in steps),
        unknown=sum(step.number == UNKNOWN for step in steps),
        calls=len(answers) or calls,
        steps=steps,
        answers=answers,
        error=error,
    )


def _asked(rooms: TrialRooms, task: ListedTask) -> tuple[str, str]:
    """Return a task's sentence, and why it cannot be begun."""
    if missing := rooms.missing(task.trial):
        return task.instruction, missing
    said = rooms.trials[task.trial].annotations
    if not task.instruction and not 0 <= task.repeat < len(said):
        return "", f"trial {task.trial} has no annotation {task.repeat}"
    return task.instruction or said[task.repeat].task_desc, ""


def _player(
    stage: LotaStage, row: LotaRow, task: ListedTask, instruction: str, seed: int
) -> LotaPlayer:
    if row.player == "scored" and stage.scorer is not None:
        return ScoredPlayer(stage.scorer, row.prompt, instruction=instruction, scoring=row.scoring)
    if row.player == "generated" and stage.model is not None:
        return GeneratedPlayer(stage.model, row.prompt, instruction=instruction, seed=seed)
    return ExpertPlayer() if row.player == "expert" else ChancePlayer(seed, "lota_alfred", task.id)


def _take_turn(environment: Environment, player: LotaPlayer) -> None:
    """Ask for skills and carry them out, whether or not they fail."""
    plan = player.plan(environment)
    for said in plan:
        if isinstance(said, str):
            environment.refuse(said)
        else:
            environment.step(said)
        if environment.end:
            return
    if not plan:
        environment.give_up("plan over" if environment.steps else "empty plan")
