"""What a run does: a suite of episodes in chains; and what a benchmark of others is to it.

A chain depends on its row, tasks and seed only, never on the process that does it or on earlier
ones. So chains can be dealt out in any way, and one whose worker died can be done again.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

import msgspec

from karma.bench.figures.drawing import Plot
from karma.bench.figures.tables import Sheet
from karma.journal.records import Key, NotRun
from karma.journal.run_folder import Finished, RunFolder
from karma.loading.models import Models, Row, check_asked, language_model
from karma.models.session import Session
from karma.types.roles import LanguageModel


class ExperimentFile(Protocol):
    """What every benchmark's experiment says; `benchmark` is the name that it is registered by."""

    name: str
    benchmark: str
    models: Models
    seeds: tuple[int, ...]

    @property
    def plans(self) -> bool:
        """Whether a row asks the planner's model."""


class PlayedEpisode(Protocol):
    """What every benchmark's record says; the same in every run of the same experiment."""

    row: str
    task: str
    seed: int
    success: bool
    end: str  # why it ended, e.g. "steps"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """Episodes that one process does in their order: what one leaves may be the next one's."""

    row: str
    tasks: tuple[str, ...]  # ids, one or more
    seed: int
    shares: str = ""  # in common with others, e.g. how a long prompt begins; "" nothing

    @property
    def key(self) -> Key:
        """What names it."""
        return self.keys[0]

    @property
    def keys(self) -> tuple[Key, ...]:
        """What names its episodes."""
        return tuple((self.row, task, self.seed) for task in self.tasks)


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkResults:
    """What records add up to."""

    figures: Any  # as results.json keeps them
    table: Sheet  # beside the published scores
    behind: tuple[Sheet, ...] = ()  # what lies behind ours
    remarks: tuple[str, ...] = ()  # what a reader of the table has to know about its rows


Play = Callable[[Chain], Iterator[Any]]  # yields a record per key, playing it when asked for it
NO_MODELS = Models(planner="", embedder="", gpu_layers=0)
Done = Finished | NotRun
Do = Callable[[Chain], Sequence[Done]]


class Suite(Protocol):
    """All that a run does of one experiment; it travels to the processes that do it."""

    @property
    def experiment(self) -> Any:
        """What its file and the command say; has `seeds`."""

    @property
    def header(self) -> Any:
        """What records depend on."""

    def files(self, folder: Path) -> RunFolder:
        """Return the folder as what takes what episodes leave."""

    def chains(self, seeds: Sequence[int]) -> Sequence[Chain]:
        """Return all episodes in their final order."""

    def added_up(self, records: Sequence[Any]) -> Mapping[str, bytes]:
        """Return what records come to, by the names of files."""

    @property
    def models(self) -> Models:
        """What workers load, hosted models where the command has them asked."""

    @property
    def rows(self) -> Sequence[Row]:
        """Those that may name models of their own."""

    def begin(self, session: Session) -> Callable[[Chain], Iterator[Done]]:
        """Load what episodes need, in the process that does them; KarmaError if that fails."""


class Benchmark(Protocol):
    """A benchmark by its own protocol, over one experiment; an entry point of karma.benchmarks.

    It is made with the experiment, of `experiment_kind`, and the path that it was read from.
    """

    experiment_kind: ClassVar[type[msgspec.Struct]]  # an `ExperimentFile`
    record_kind: ClassVar[type]  # a `PlayedEpisode`, a dataclass

    def chains(self) -> Sequence[Chain]:
        """Return all episodes in their final order; FileError where lists are damaged."""

    def files(self) -> Sequence[Path]:
        """Return the files that records depend on, beside the experiment and the models."""

    def begin(self, session: Session) -> Play:
        """Load what episodes need, in the process that plays them; KarmaError if that fails."""

    def results(self, records: Sequence[Any]) -> BenchmarkResults:
        """Return what records come to, finished or not; FileError for damaged published scores."""

    def pictures(self, records: Sequence[Any]) -> Sequence[Plot]:
        """Return the pictures of the report page; () for none."""


def planner_of(models: Models, session: Session, seed: int) -> LanguageModel:
    """Return the model that plans; it is not held to programs, which no benchmark asks for.

    Raises:
        ModelError: see `language_model`.
    """
    model, _ = language_model(msgspec.structs.replace(models, constraint="free"), session, seed)
    check_asked(model, "compact")  # benchmarks' prompts are longer
    return model
