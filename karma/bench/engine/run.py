"""A run: an experiment in its folder, begun, gone on with, and finished."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from karma.bench.engine.benchmark_runs import BenchmarkSuite, benchmark_suite
from karma.bench.engine.experiment_file import Changes, kind_of
from karma.bench.engine.our_tasks import OurTasks, our_tasks
from karma.bench.engine.suite import BenchmarkResults, Chain, Suite
from karma.bench.engine.workers import IN_FLIGHT, Suggestion, check_far, perform, suggest_workers
from karma.errors import KarmaError
from karma.journal.folder import EPISODES, locked
from karma.journal.records import IN_A_ROW, Key, NotRun, key_of
from karma.models.session import Cassette, Session
from karma.types.tasks import Task


class Run:
    """An experiment in its folder: of our own tasks, or of a benchmark by its own protocol.

    The folder takes records, header and whatever else episodes leave; `fresh` sets aside the
    folder of an earlier run, whose path is then `earlier`. `changes`, `computed` (keys of its
    [models] that say how they are computed), `base_url` (of all hosted models) and `steps` (whether
    to keep step logs) stand in place of what the experiment says; the last is of no use to a
    benchmark. The cassette records hosted models or stands for them, and is the run's clock. A
    `suite` is what is done where it is of neither form; then `path` is only named in messages.

    Raises:
        FileError: the experiment is damaged, or the folder holds a run of something else.
        KarmaError: another run is at work in the folder, its tasks have one seed only, or an
            argument is of no use to it.
    """

    def __init__(
        self,
        path: Path,
        folder: Path,
        *,
        changes: Changes | None = None,
        fresh: bool = False,
        cassette: Cassette | None = None,
        base_url: str = "",
        computed: Mapping[str, Any] | None = None,
        steps: bool | None = None,
        suite: Suite | None = None,
    ) -> None:
        self.path, self.folder = path, folder
        self._session = Session(cassette)
        said = (path, changes, computed or {}, base_url)
        self.suite: Suite
        if suite is not None:
            self.suite = suite
        elif kind_of(path, changes) == "benchmark":
            if steps is not None:
                raise KarmaError(f"{path}: a benchmark has no steps")
            self.suite = benchmark_suite(*said)
        else:
            self.suite = our_tasks(*said, folder=folder, steps=steps is not False)
        self.experiment: Any = self.suite.experiment  # an `Experiment`, or a benchmark's own
        ours = self.suite if isinstance(self.suite, OurTasks) else None
        self.tasks: tuple[Task, ...] = ours.placed() if ours else ()  # of our own
        self._scenes = ours.brought() if ours else {}
        self.header = self.suite.header
        self._files = self.suite.files(folder)
        self.records: list[Any] = []
        self.not_run: list[NotRun] = []  # of those that were tried last
        self.timings: dict[Key, Any] = {}
        self.chains = tuple(self.suite.chains(self.experiment.seeds))
        self.earlier = self._make_way(fresh)
        with locked(folder):
            self._claim()
            self._go_on()

    @property
    def records_path(self) -> Path:
        """Where the records are."""
        return self.folder / EPISODES

    @property
    def total(self) -> int:
        """How many episodes there are."""
        return sum(len(chain.tasks) for chain in self.chains)

    @property
    def left(self) -> int:
        """How many of them are not done yet."""
        return self.total - len(self.records)

    def suggest(self) -> Suggestion:
        """Return how many workers to use unless a number is given."""
        models, in_flight = self.suite.models, None
        if models.hosted.planner is not None and self._session.cassette.mode != "replay":
            in_flight = IN_FLIGHT
        return suggest_workers(models, self.left, self.suite.rows, in_flight=in_flight)

    def episodes(self, workers: int = 1, *, ray: str = "") -> Iterator[Any]:
        """Do what is missing; each record is on the disk before it is yielded.

        When the last is done, all lines are put in their final order, in whatever order they were
        done. What was not run is in `not_run` afterwards; then the run is not finished.

        Each of the workers is a process with models of its own. `ray` is the address of a cluster
        whose machines do the episodes; then 0 workers are as many as it has room for.

        Raises:
            KarmaError: a model cannot be loaded or a hosted one not reached, a row has a wrong
                option, a cluster is to ask hosted models, another run is at work in the folder, or
                several episodes in a row were not run.
        """
        if ray:
            check_far(self.suite.models, self._session.cassette)
        with locked(self.folder):
            self._claim()
            self._go_on()
            if self.left:
                self._files.reopen()
            self.not_run, in_a_row = [], 0
            todo = self._todo()
            work = perform(
                self.suite, todo, self._session, workers=workers, ray=ray, header=self.header
            )
            for one in work if todo else ():
                if isinstance(one, NotRun):
                    in_a_row += not one.alone
                    self._put_aside(one, ends=in_a_row == IN_A_ROW)
                    continue
                in_a_row = 0
                self._files.commit(one)
                self.records.append(one.record)
                self.timings[one.timing.key] = one.timing
                yield one.record
            if not self.not_run:
                order = [key for chain in self.chains for key in chain.keys]
                self._files.finish(order, self.suite.added_up)
                self.records, self.timings = self._files.done()

    def results(self) -> BenchmarkResults:
        """Return what a benchmark's records so far come to; errors as `Benchmark.results`."""
        assert isinstance(self.suite, BenchmarkSuite)
        return self.suite.results(self.records, self.not_run)

    # ------------------------------------------------------------- parts

    def _put_aside(self, one: NotRun, *, ends: bool) -> None:
        """Keep why an episode was not run; `ends`: so many were not that none would be."""
        self.not_run.append(one)
        self._files.put_aside(one)
        if ends:
            raise KarmaError(f"{IN_A_ROW} episodes one after the other were not run: {one.reason}")

    def _make_way(self, fresh: bool) -> Path | None:
        """Set an earlier run aside; KarmaError where this one's cassette lies in its folder."""
        tape = self._session.cassette.tape.folder
        if fresh and tape is not None and tape.resolve().is_relative_to(self.folder.resolve()):
            fix = "move the cassette out of it, or leave out --fresh"
            raise KarmaError(f"{self.folder}: the cassette {tape} lies in it\n  To fix: {fix}")
        return self._files.make_way(self.header, fresh=fresh)

    def _claim(self) -> None:
        fix = f"--out another folder, or karma eval {self.path} --fresh, which sets that run aside"
        self._files.claim(self.header, fix=fix, scenes=self._scenes)

    def _go_on(self) -> None:
        """Read what is done."""
        together = [chain.keys for chain in self.chains if len(chain.tasks) > 1]
        self.records, self.timings = self._files.done(together)

    def _todo(self) -> list[Chain]:
        done = {key_of(record) for record in self.records}
        return [chain for chain in self.chains if not done.issuperset(chain.keys)]
