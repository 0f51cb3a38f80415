"""What a run's records depend on: the header of its folder, and in what two headers differ."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import msgspec

from karma.agent.journal.folder import brief, changed
from karma.agent.journal.not_run import FILE as NOT_RUN
from karma.agent.journal.owned_folder import HEADER, benchmark_in, kind_in
from karma.agent.journal.told import CONFIG, Config, all_apart, without_places
from karma.errors import FileError
from karma.files import read_json, to_json

FORMAT = 6  # of the folder; 1 had times among the records, 2 no methods or rooms, 3 no tours,
# 4 no engine and no refused prompts, 5 no goals met at the start and no tasks left unjudged
EPISODES, TIMINGS, RESULTS = "episodes.jsonl", "timings.jsonl", "results.json"
TABLE = "table.md"
CELLS = "cells"  # of a sweep's folder, see `karma.bench.engine.sweep_folder`
_WAITING = ("timeout_s", "retries")  # of an endpoint: a request that is given up leaves no record
ALWAYS = frozenset({HEADER, EPISODES, TIMINGS, RESULTS, NOT_RUN})


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """Where a run was begun; decides nothing."""

    platform: str
    cpu: str
    cores: int
    memory_mb: int | None
    threads: int  # of each planner
    devices: tuple[str, ...] = ()  # that llama.cpp can compute on, as it names and describes them


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What the records of a run of our own tasks depend on; a folder never mixes two."""

    name: str  # of the experiment
    experiment: str  # SHA-256 of its content
    tasks: str  # SHA-256 of the tasks
    versions: Mapping[str, str]  # of this package and of what computes
    models: Mapping[str, str]  # role -> name and SHA-256
    prompts: Mapping[str, str]  # template -> SHA-256
    scenes: Mapping[str, str]  # name -> SHA-256
    network: bool = False  # started with --allow-network
    steps: bool = True  # whether step logs are kept
    format: int
    machine: Machine = field(compare=False)

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a header; FileError for none, one of an earlier form or of another kind of run."""
        _refuse_others(folder)
        path = folder / HEADER
        if not path.exists():
            fix = "karma eval FILE --out FOLDER"
            raise FileError(path, "there is no run in this folder", fix=fix)
        fix = "run it again: karma eval FILE --out another folder"
        try:
            header = read_json(path, cls)
        except FileError as error:
            reason = f"this folder holds no run of the present form ({error.reason})"
            raise FileError(path, reason, fix=fix) from error
        if header.format != FORMAT:
            raise FileError(path, f"the run is of form {header.format}, not {FORMAT}", fix=fix)
        return header

    @property
    def names(self) -> frozenset[str]:
        """The files that such a run may write, but for those of its episodes."""
        return ALWAYS | {CONFIG, *(f"maps/{scene}.json" for scene in self.scenes)}

    def apart(
        self, new: "Header", told: Config | None = None, now: Config | None = None
    ) -> list[str]:
        """Return what tells another header apart, in words.

        Where both configurations are known, options that differ are named.
        """
        options = all_apart(told, now) if told is not None and now is not None else []
        found = [
            f"{what}: {brief(str(one))} became {brief(str(other))}"
            for what, one, other in (
                ("name", self.name, new.name),
                ("experiment file", self.experiment, new.experiment),
                ("tasks", self.tasks, new.tasks),
                ("--allow-network", self.network, new.network),
                ("step logs", self.steps, new.steps),
            )
            if one != other and not (what == "experiment file" and options)
        ]
        found += options if self.experiment != new.experiment else []
        for what in ("versions", "models", "prompts", "scenes"):
            found += changed(what, getattr(self, what), getattr(new, what))
        return found


def _refuse_others(folder: Path) -> None:
    """Raise FileError where a folder holds another kind of run, which has no such records."""
    match kind_in(folder):
        case "sweep":
            fix = f"name one of the folders in {folder / CELLS}"
            raise FileError(folder, "a sweep, of many runs", fix=fix)
        case "figure":
            fix = f"karma report {folder}"
            raise FileError(folder, "a figure of policies, which has no episodes", fix=fix)
        case "benchmark":
            what = f"a run of the benchmark {benchmark_in(folder)}, which has records of its own"
            fix = f"karma table {folder}"
            raise FileError(folder / HEADER, f"{what}: they are not read here", fix=fix)


class BenchmarkHeader(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the records of a benchmark's run depend on."""

    benchmark: str
    name: str  # of the experiment
    experiment: dict[str, Any]  # all that it says
    files: dict[str, str]  # of the benchmark and the prompt: name -> SHA-256
    versions: dict[str, str]
    models: dict[str, str]
    network: bool = False  # started with --allow-network

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read what a run depends on; FileError where it is damaged, or no benchmark's."""
        return read_json(folder / HEADER, cls, fix="karma eval FILE --out another folder")

    @property
    def names(self) -> frozenset[str]:
        """The files that such a run may write."""
        return ALWAYS | {TABLE}

    def apart(self, new: "BenchmarkHeader") -> list[str]:
        """Return what tells another header apart, in words."""
        found = []
        for what in ("benchmark", "name", "network"):
            one, other = str(getattr(self, what)), str(getattr(new, what))
            found += changed("run", {what: one}, {what: other})
        found += changed("experiment", _lines(self.experiment), _lines(new.experiment))
        for what in ("files", "versions", "models"):
            found += changed(what, getattr(self, what), getattr(new, what))
        return found


def _lines(experiment: Mapping[str, Any]) -> dict[str, str]:
    """Return an experiment as text by key, without what decides nothing."""
    plain: dict[str, Any] = without_places(msgspec.json.decode(msgspec.json.encode(experiment)))
    for endpoint in filter(None, plain["models"]["hosted"].values()):
        for name in _WAITING:
            del endpoint[name]
    return {key: to_json(value).decode().strip() for key, value in plain.items()}
