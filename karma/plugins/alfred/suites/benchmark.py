"""EB-ALFRED and LoTa-Bench's ALFRED as a run plays them: chains, episodes, records, tables."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, ClassVar

from karma.bench.engine.suite import BenchmarkResults, Chain, Play, planner_of
from karma.errors import FileError, KarmaError
from karma.journal.records import NotRun
from karma.models.session import Session
from karma.plugins.alfred.eb_world.actions import EB_ALFRED, LOTA_ALFRED, ActionTypes, read_types
from karma.plugins.alfred.eb_world.environment import UNKNOWN, Environment, Step
from karma.plugins.alfred.published_tasks import ListedTask
from karma.plugins.alfred.replay.facts import RoomFacts, gather, side_files
from karma.plugins.alfred.replay.trial import Trial, read_trials, trial_files
from karma.plugins.alfred.suites.eb_planner import PlannerAnswer, PlannerPlayer
from karma.plugins.alfred.suites.experiment import EbExperiment, EbRow, LotaExperiment, LotaRow
from karma.plugins.alfred.suites.lota_planner import GeneratedPlayer, LotaAnswer, ScoredPlayer
from karma.plugins.alfred.suites.players import BenchmarkPlayer, ChancePlayer, ExpertPlayer
from karma.plugins.alfred.suites.table import EB_TABLES, LOTA_TABLES, results_of
from karma.plugins.baselines.lota import chooser_of
from karma.types.roles import LanguageModel

_HERE = Path(__file__).parent


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRooms:
    """The demonstrations by id, and what is known of their rooms."""

    trials: Mapping[str, Trial]
    facts: Mapping[str, RoomFacts]

    def missing(self, trial: str) -> str:
        """Return why a trial cannot be begun; "" if it can."""
        if trial not in self.trials:
            return f"there is no trial {trial}"
        if not self.facts[self.trials[trial].scene.floor_plan].cells:
            return f"there is nothing to stand on in {self.trials[trial].scene.floor_plan}"
        return ""


def read_rooms(path: Path, listed: Collection[str] = ()) -> TrialRooms:
    """Read the demonstrations of a file, and what is known of their rooms.

    FileError if a file is missing, torn or of another form, or most that are listed are not
    there: the list is of other demonstrations.
    """
    trials = {trial.id: trial for trial in read_trials(path)}
    there = len({*listed} & trials.keys())
    if 2 * there < len({*listed}):
        reason = f"holds {there} of the {len({*listed})} trials that are listed"
        raise FileError(path, reason, fix="trials = the file of the split that the list is of")
    return TrialRooms(trials=trials, facts=gather(trials.values(), side_files()))


def room_files(path: Path) -> list[Path]:
    """Return the files of demonstrations, and those that tell of their rooms."""
    return [*trial_files(path), *filter(None, astuple(side_files()))]


@dataclass(frozen=True, slots=True, kw_only=True)
class AlfredRecord:
    """What an episode leaves behind; the same in every run of the same experiment."""

    row: str
    task: str
    seed: int
    trial: str
    instruction: str
    success: bool
    end: str  # as `Environment.end`, or "error"
    calls: int  # of the player
    steps: tuple[Step, ...]
    error: str = ""  # what ended the episode from outside


@dataclass(frozen=True, slots=True, kw_only=True)
class EbRecord(AlfredRecord):
    """What an episode of EB-ALFRED leaves behind."""

    subset: str
    progress: float  # conditions that were met at the end, of all
    invalid: int  # actions, unusable answers counted
    answers: tuple[PlannerAnswer, ...] = ()

    @property
    def no_json(self) -> int:
        """Answers that were no JSON of the form that was asked for."""
        return sum(answer.no_json for answer in self.answers)


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaRecord(AlfredRecord):
    """What an episode of LoTa-Bench's ALFRED leaves behind."""

    kind: str  # type of task
    failed: int  # skills, unknown ones too
    unknown: int  # skills that there are not
    answers: tuple[LotaAnswer, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class AlfredStage:
    """What all episodes share."""

    rooms: TrialRooms
    types: ActionTypes
    model: LanguageModel | None  # None where no row asks one


def play(
    stage: AlfredStage, row: EbRow | LotaRow, task: ListedTask, seed: int, puts: dict[str, int]
) -> EbRecord | LotaRecord | NotRun:
    """Play an episode, if it can be begun; what a model could not be asked is in the record.

    `puts` are counts of puts, which a strict row's next episode of a chain goes on with.
    KarmaError for what is no player's doing, e.g. a server is lost or the disk full.
    """
    instruction, missing = _asked(stage.rooms, task)
    if missing:
        return NotRun(row=row.name, task=task.id, seed=seed, reason=missing, alone=True)
    player = _player(stage, row, task, instruction, seed)
    calls, error = 0, ""
    trial = stage.rooms.trials[task.trial]
    environment = Environment(
        trial,
        stage.rooms.facts[trial.scene.floor_plan],
        stage.types,
        protocol=EB_ALFRED if isinstance(row, EbRow) else LOTA_ALFRED,
        strict=row.strict,
        puts=puts,
    )
    try:
        while not environment.end:
            calls += 1
            _take_turn(environment, player)
    except KarmaError as problem:
        if not problem.agents_own:
            raise
        error = str(problem)
    said: dict[str, Any] = {
        "row": row.name,
        "task": task.id,
        "seed": seed,
        "trial": task.trial,
        "instruction": instruction,
        "end": "error" if error else environment.end,
        "steps": tuple(environment.steps),
        "answers": tuple(player.answers),
        "error": error,
    }
    if isinstance(row, EbRow):
        return _eb_record(environment, subset=task.list, calls=calls, **said)
    return LotaRecord(
        kind=task.folder.partition("-")[0],
        success=not error and environment.goal_met,
        failed=sum(not step.ok for step in environment.steps),
        unknown=sum(step.number == UNKNOWN for step in environment.steps),
        calls=len(player.answers) or calls,
        **said,
    )


def _eb_record(environment: Environment, **said: Any) -> EbRecord:
    answers, met = said["answers"], environment.conditions
    unplayed = environment.end == "empty plan" or bool(answers and answers[-1].error)
    return EbRecord(
        success=environment.end == "goal met",
        # the source loses the progress when a plan ends it
        progress=0.0 if environment.strict and unplayed else met.met / met.of,
        invalid=environment.invalid,
        **said,
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
    stage: AlfredStage, row: EbRow | LotaRow, task: ListedTask, instruction: str, seed: int
) -> BenchmarkPlayer:
    if row.player == "expert":
        return ExpertPlayer()
    if row.player == "chance" or stage.model is None:
        return ChancePlayer(seed, "eb_alfred" if isinstance(row, EbRow) else "lota_alfred", task.id)
    asked: dict[str, Any] = {"model": stage.model, "options": row.prompt}
    asked["instruction"] = instruction
    if isinstance(row, EbRow):
        return PlannerPlayer(subset=task.list, seed=seed, **asked)
    if row.player == "scored":
        return ScoredPlayer(scoring=row.scoring, **asked)
    return GeneratedPlayer(seed=seed, **asked)


def _take_turn(environment: Environment, player: BenchmarkPlayer) -> None:
    """Ask for a plan and carry it out, up to a failure where the planner is asked anew."""
    plan = player.plan(environment)
    if plan is None:
        environment.count_unusable()
    elif not plan:
        environment.give_up()
    for said in plan or ():
        step = environment.step(said)
        if environment.end or not (step.ok or environment.protocol.goes_on):
            return


# ----------------------------------------------------------------- the suites of a run


class _AlfredSuite:
    """ALFRED's tasks over an experiment, see `Benchmark`."""

    experiment_kind: ClassVar[type[Any]]
    record_kind: ClassVar[type[Any]]
    counts_on = False  # whether a strict row's puts count in the next episode of a list

    def __init__(self, experiment: Any, path: Path) -> None:
        self._experiment, self._path = experiment, path

    def chains(self) -> list[Chain]:
        """Return all episodes, each by itself, or those of a list where their puts count on."""
        one = self._experiment
        tasks = one.chosen(self._path)
        lists: dict[str, list[ListedTask]] = {}
        for task in tasks:
            lists.setdefault(task.list, []).append(task)
        together, apart = [*lists.values()], [[task] for task in tasks]
        return [
            Chain(
                row=row.name,
                tasks=tuple(task.id for task in group),
                seed=seed,
                shares=row.shares(group[0]) if isinstance(row, EbRow) else "",
            )
            for seed in one.seeds
            for row in one.rows
            for group in (together if row.strict and self.counts_on else apart)
        ]

    def files(self) -> list[Path]:
        """Return the prompt's and the benchmark's files, and what tells of the rooms."""
        one = self._experiment
        theirs = [Path(one.tasks), Path(one.types), *room_files(Path(one.trials))]
        return [_HERE / one.benchmark / name for name in ("prompt.toml", "examples.toml")] + theirs

    def pictures(self, records: Sequence[Any]) -> tuple[()]:
        """Return no picture: the tables say all."""
        return ()

    def begin(self, session: Session) -> Play:
        """Load rooms, lists of types and, where a row asks it, the planner.

        ModelError if skills are to be scored, and the model cannot.
        """
        one = self._experiment
        tasks = {task.id: task for task in one.chosen(self._path)}
        model = planner_of(one.models, session, one.seeds[0]) if one.plans else None
        scored = [row.name for row in one.rows if row.player == "scored"]
        if model is not None and scored:
            chooser_of(model, scored[0], 'with player = "generated"')
        stage = AlfredStage(
            rooms=read_rooms(Path(one.trials), [task.trial for task in tasks.values()]),
            types=read_types(Path(one.types)),
            model=model,
        )
        rows = {row.name: row for row in one.rows}

        def played(chain: Chain) -> Iterator[EbRecord | LotaRecord | NotRun]:
            puts: dict[str, int] = {}
            for task in chain.tasks:
                yield play(stage, rows[chain.row], tasks[task], chain.seed, puts)

        return played


class EbAlfred(_AlfredSuite):
    """EB-ALFRED."""

    experiment_kind: ClassVar[type[Any]] = EbExperiment
    record_kind: ClassVar[type[Any]] = EbRecord
    counts_on = True

    def results(self, records: Sequence[EbRecord]) -> BenchmarkResults:
        """Return success rates by list, and what lies behind them."""
        one = self._experiment
        published = Path(one.published) if one.published else None
        return results_of(records, EB_TABLES, published, tuple(one.remarks()))


class LotaAlfred(_AlfredSuite):
    """LoTa-Bench's ALFRED."""

    experiment_kind: ClassVar[type[Any]] = LotaExperiment
    record_kind: ClassVar[type[Any]] = LotaRecord

    def results(self, records: Sequence[LotaRecord]) -> BenchmarkResults:
        """Return success rates by type of task, and what lies behind them."""
        return results_of(records, LOTA_TABLES)
