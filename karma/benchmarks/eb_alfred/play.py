"""Play one episode, and say what it came to."""

from dataclasses import dataclass

from karma.benchmarks.eb_alfred.experiment import EbRow
from karma.benchmarks.eb_alfred.planner import PlannerAnswer, PlannerPlayer
from karma.benchmarks.players import BenchmarkPlayer, ChancePlayer, ExpertPlayer
from karma.benchmarks.trial_rooms import TrialRooms
from karma.contracts import LanguageModel
from karma.errors import KarmaError
from karma.journal.not_run import NotRun
from karma.tasks.alfred_lists import ListedTask
from karma.world.eb_alfred.actions import ActionTypes
from karma.world.eb_alfred.environment import Environment, Step


@dataclass(frozen=True, slots=True, kw_only=True)
class EbRecord:
    """What an episode leaves behind; the same in every run of the same experiment."""

    row: str
    task: str
    subset: str
    seed: int
    trial: str
    instruction: str
    success: bool
    progress: float  # conditions that were met at the end, of all
    end: str  # "goal met", "steps", "invalid actions", "empty plan", "error"
    invalid: int  # actions, unusable answers counted
    calls: int  # of the player
    steps: tuple[Step, ...]
    answers: tuple[PlannerAnswer, ...] = ()
    error: str = ""  # what ended the episode from outside

    @property
    def no_json(self) -> int:
        """Answers that were no JSON of the form that was asked for."""
        return sum(answer.no_json for answer in self.answers)


@dataclass(frozen=True, slots=True, kw_only=True)
class EbStage:
    """What all episodes share."""

    rooms: TrialRooms
    types: ActionTypes
    model: LanguageModel | None  # None where no row asks one


def play(
    stage: EbStage, row: EbRow, task: ListedTask, seed: int, puts: dict[str, int]
) -> EbRecord | NotRun:
    """Play an episode, if it can be begun; what a model could not be asked is in the record.

    Args:
        stage: what all share.
        row: who plays.
        task: what is asked for.
        seed: of the player's draws.
        puts: counts of puts, which a strict row's next episode goes on with.

    Raises:
        KarmaError: what is no player's doing, e.g. a server is lost or the disk full.
    """
    if missing := stage.rooms.missing(task.trial):
        return NotRun(row=row.name, task=task.id, seed=seed, reason=missing, alone=True)
    player = _player(stage, row, task, seed)
    calls, error = 0, ""
    trial = stage.rooms.trials[task.trial]
    environment = Environment(
        trial,
        stage.rooms.facts[trial.scene.floor_plan],
        stage.types,
        strict=row.strict,
        puts=puts if row.strict else None,
    )
    try:
        while not environment.end:
            calls += 1
            _take_turn(environment, player)
    except KarmaError as problem:
        if not problem.agents_own:
            raise
        error = str(problem)
    answers = tuple(player.answers) if isinstance(player, PlannerPlayer) else ()
    return _record(row, task, seed, environment, calls=calls, answers=answers, error=error)


def _player(stage: EbStage, row: EbRow, task: ListedTask, seed: int) -> BenchmarkPlayer:
    if row.player == "expert":
        return ExpertPlayer()
    if row.player == "chance" or stage.model is None:
        return ChancePlayer(seed, "eb_alfred", task.id)
    return PlannerPlayer(
        stage.model, row.prompt, instruction=task.instruction, subset=task.list, seed=seed
    )


def _take_turn(environment: Environment, player: BenchmarkPlayer) -> None:
    """Ask for a plan and carry it out up to the first action that fails."""
    plan = player.plan(environment)
    if plan is None:
        environment.count_unusable()
    elif not plan:
        environment.give_up()
    for number in plan or ():
        step = environment.step(number)
        if environment.end or not step.ok:
            return


def _record(
    row: EbRow,
    task: ListedTask,
    seed: int,
    environment: Environment,
    *,
    calls: int,
    answers: tuple[PlannerAnswer, ...],
    error: str,
) -> EbRecord:
    met, end = environment.conditions, environment.end
    unplayed = end == "empty plan" or bool(answers and answers[-1].error)
    # the source loses the progress when a plan ends it
    progress = 0.0 if row.strict and unplayed else met.met / met.of
    return EbRecord(
        row=row.name,
        task=task.id,
        subset=task.list,
        seed=seed,
        trial=task.trial,
        instruction=task.instruction,
        success=end == "goal met",
        progress=progress,
        end="error" if error else end,
        invalid=environment.invalid,
        calls=calls,
        steps=tuple(environment.steps),
        answers=answers,
        error=error,
    )
