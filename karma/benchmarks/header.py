"""What a benchmark's run depends on, as its folder keeps it and every node is held against."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from karma import registry
from karma.benchmarks.benchmark import Benchmark, ExperimentFile
from karma.errors import FileError, UnknownNameError
from karma.files import read_bytes, read_json, to_json
from karma.journal.folder import changed
from karma.journal.owned_folder import HEADER
from karma.journal.provenance import model_hashes, versions
from karma.journal.told import without_places
from karma.offline import network_allowed

_WAITING = ("timeout_s", "retries")  # of an endpoint: a request that is given up leaves no record


class BenchmarkHeader(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a run's records depend on."""

    benchmark: str
    name: str  # of the experiment
    experiment: dict[str, Any]  # all that it says
    files: dict[str, str]  # of the benchmark and the prompt: name -> SHA-256
    versions: dict[str, str]
    models: dict[str, str]
    network: bool = False  # started with --allow-network


def header_of(experiment: ExperimentFile, benchmark: Benchmark) -> BenchmarkHeader:
    """Return what a run depends on.

    Args:
        experiment: as its file and the command say it.
        benchmark: made from it.

    Raises:
        FileError: a file that records depend on is missing.
        ModelError: a model's file is missing.
        UnknownNameError: there is no such model.
    """
    return BenchmarkHeader(
        benchmark=experiment.benchmark,
        name=experiment.name,
        experiment=msgspec.to_builtins(experiment),
        files=file_hashes(benchmark),
        versions=versions(),
        models=model_hashes(experiment.models) if experiment.plans else {},
        network=network_allowed(),
    )


def file_hashes(benchmark: Benchmark) -> dict[str, str]:
    """Return the hash of each file that records depend on, by its name; FileError for one lost."""
    files = benchmark.files()
    return {file.name: hashlib.sha256(read_bytes(file)).hexdigest() for file in files}


def read_header(folder: Path) -> BenchmarkHeader:
    """Read what a run depends on.

    Raises:
        FileError: it is damaged, or of a run that is no benchmark's.
    """
    fix = "karma eval FILE --out another folder"
    return read_json(folder / HEADER, BenchmarkHeader, fix=fix)


def differences(old: BenchmarkHeader, new: BenchmarkHeader) -> list[str]:
    """Return what tells two headers apart, in words."""
    found = []
    for what in ("benchmark", "name", "network"):
        found += changed("run", {what: str(getattr(old, what))}, {what: str(getattr(new, what))})
    found += changed("experiment", _lines(old.experiment), _lines(new.experiment))
    for what in ("files", "versions", "models"):
        found += changed(what, getattr(old, what), getattr(new, what))
    return found


def _lines(experiment: Mapping[str, Any]) -> dict[str, str]:
    """Return an experiment as text by key, without what decides nothing."""
    plain: dict[str, Any] = without_places(msgspec.json.decode(msgspec.json.encode(experiment)))
    for endpoint in filter(None, plain["models"]["hosted"].values()):
        for name in _WAITING:
            del endpoint[name]
    return {key: to_json(value).decode().strip() for key, value in plain.items()}


def kind_of(name: str, path: Path) -> Any:
    """Return the class of a benchmark.

    Raises:
        FileError: there is no such benchmark; `path` names it.
    """
    try:
        return registry.load("benchmarks", name)
    except UnknownNameError as error:
        raise FileError(path, f"benchmark: {error}") from error
