"""Lived-in homes as a run plays them: a chain for each row in each home, a record a day."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, ClassVar

from karma.bench.engine.suite import BenchmarkResults, Chain, Play
from karma.bench.figures.drawing import Plot
from karma.errors import KarmaError
from karma.loading.models import filled
from karma.models.session import Session
from karma.plugins.homes.habits import TABLE
from karma.plugins.homes.lived.experiment import LivedExperiment
from karma.plugins.homes.lived.pictures import curves_picture, lived_pictures
from karma.plugins.homes.lived.play import HomeLife
from karma.plugins.homes.lived.reading import Reader
from karma.plugins.homes.lived.request import FORMS, LivedRecord
from karma.plugins.homes.lived.table import (
    by_day,
    figures_of,
    kinds_sheet,
    known_sheet,
    remarks_on,
    stale_shares,
    truth_sheet,
    work_sheet,
)
from karma.plugins.homes.memory.ageing import PRIOR
from karma.types.roles import Embedder


class LivedHomes:
    """Days of family life over an experiment, see `Benchmark`."""

    experiment_kind: ClassVar[type[Any]] = LivedExperiment
    record_kind: ClassVar[type[Any]] = LivedRecord

    def __init__(self, experiment: LivedExperiment, path: Path) -> None:
        self._experiment, self._path = experiment, path

    def chains(self) -> list[Chain]:
        """Return a chain for each row in each home; the rows of a home stand together."""
        one = self._experiment
        return [
            Chain(
                row=row.name,
                tasks=tuple(f"{spec.name}/day_{day}" for day in range(one.days)),
                seed=seed,
                shares=spec.name,
            )
            for seed in one.seeds
            for spec in one.specs()
            for row in one.rows
        ]

    def files(self) -> list[Path]:
        """Return habits, sentences and the prior that memories begin with."""
        return [TABLE, FORMS, PRIOR]

    def begin(self, session: Session) -> Play:
        """Load the embedder and the reader's words."""
        reader = Reader(self._embedder(session))

        def played(chain: Chain) -> Iterator[LivedRecord]:
            with closing(self._life(chain, reader)) as life:
                for day in range(self._experiment.days):
                    yield life.day(day)

        return played

    def _life(self, chain: Chain, reader: Reader) -> HomeLife:
        one, home = self._experiment, chain.tasks[0].rpartition("/")[0]
        row = next(row for row in one.rows if row.name == chain.row)
        spec = next(spec for spec in one.specs() if spec.name == home)
        return HomeLife(one, row, spec, chain.seed, reader)

    def results(self, records: Sequence[LivedRecord]) -> BenchmarkResults:
        """Return success by kind of request, and what lies behind it."""
        figures = figures_of(records)
        return BenchmarkResults(
            figures=figures,
            table=kinds_sheet(figures),
            behind=tuple(
                sheet
                for sheet in (truth_sheet(figures), work_sheet(figures), known_sheet(figures))
                if sheet.lines
            ),
            remarks=(*remarks_on(self._experiment), *self._without_room(records)),
        )

    def pictures(self, records: Sequence[LivedRecord]) -> list[Plot]:
        """Return success by kind, over settings, and over days where there is one setting."""
        found = list(lived_pictures(figures_of(records), stale_shares(records)))
        if len({one.setting for one in records}) == 1 and len({one.day for one in records}) > 1:
            days = by_day(records)
            found.append(curves_picture("Over days lived", figures_of(days), stale_shares(days)))
        return found

    def _without_room(self, records: Sequence[LivedRecord]) -> Iterator[str]:
        """Yield the settings whose homes have fewer things than were asked for."""
        for setting in self._experiment.settings:
            had = [one.things for one in records if one.setting == setting.name]
            if had and min(had) < (setting.things or 0):
                yield (
                    f"{setting.name}: things = {setting.things:,} did not find room;"
                    f" homes have {min(had):,} to {max(had):,}."
                )

    def _embedder(self, session: Session) -> Embedder:
        models = self._experiment.models
        embedder: Embedder | None = filled("embedders", models.embedder, None, session, models)
        if embedder is None:
            raise KarmaError(f"{self._path}: an embedder is needed\n  To fix: embedder = 'minilm'")
        return embedder
