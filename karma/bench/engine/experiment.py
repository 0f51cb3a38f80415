"""An experiment is a TOML file: tasks, models, and one row per method."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from karma.agent.loading.models import Models, Row
from karma.bench.figures.precision import MAX_SEEDS, Precision
from karma.bench.tasks.alfred import AlfredTasks
from karma.infer.llama.room_states import StateOptions

MOST_SEEDS = 10_000


class RunOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a run is kept; its records do not depend on it."""

    steps: bool = True  # a step log per episode
    states: str = ""  # folder that KV states of rooms are kept in for later runs; "" = none
    states_mb: int = StateOptions().folder_mb  # at most in it
    states_memory_mb: int = StateOptions().memory_mb  # at most in each process

    def __post_init__(self) -> None:
        """Refuse a size below nothing."""
        if min(self.states_mb, self.states_memory_mb) < 0:
            raise ValueError("states_mb and states_memory_mb are 0 or more")

    @property
    def room_states(self) -> StateOptions:
        """Where states of rooms are kept."""
        return StateOptions(
            folder=Path(self.states) if self.states else None,
            folder_mb=self.states_mb,
            memory_mb=self.states_memory_mb,
        )


def check_listed(
    rows: Sequence[str], seeds: Sequence[int], only: Sequence[str], settings: Sequence[str] = ()
) -> None:
    """Raise ValueError where an experiment has nothing to do, or names something twice."""
    listed: Sequence[object]
    for what, listed in (("rows", rows), ("seeds", seeds), ("only", only), ("settings", settings)):
        if twice := [one for one, times in Counter(listed).items() if times > 1]:
            raise ValueError(f"{what}: {twice[0]!r} stands twice")
    if not rows:
        raise ValueError("rows: there is none; an experiment has a [[rows]] or more")
    if len(seeds) > MOST_SEEDS:
        raise ValueError(f"seeds: {len(seeds)} are too many; {MOST_SEEDS} at most")
    if not seeds or min(seeds) < 0:
        raise ValueError(f"seeds = {list(seeds)}: one or more, each 0 or above")


class Experiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One table: every row on every task with every seed."""

    name: str
    rows: tuple[Row, ...]
    tasks: str = ""  # our JSONL
    authors: tuple[str, ...] = ()  # or the authors' JSON files
    alfred: AlfredTasks | None = None  # or ALFRED's trials
    scenes: str = ""  # an AI2-THOR dump that the authors' floor plans come from
    layouts: str = ""  # reachable cells for them
    only: tuple[str, ...] = ()  # task ids, "*" is any text; () = all
    limit: int | None = None  # the first so many of them; None: all
    world: str = "embedded"
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)
    half_width: float | None = None  # more seeds until success rates are as sure as that
    max_seeds: int = MAX_SEEDS  # with it, the listed ones counted
    run: RunOptions = RunOptions()
    grid: tuple[
        dict[str, Any], ...
    ] = ()  # sweeps: lists of values by key, see `karma.bench.engine.sweep`

    def __post_init__(self) -> None:
        """Refuse what there is nothing to do for, or what would be done twice."""
        check_listed([row.name for row in self.rows], self.seeds, self.only)
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"limit = {self.limit}: 1 or more, or none")
        _ = self.precision

    @property
    def precision(self) -> Precision | None:
        """How sure success rates are wanted to be; None: the listed seeds, whatever they show."""
        if self.half_width is None:
            return None
        return Precision(half_width=self.half_width, max_seeds=self.max_seeds)
