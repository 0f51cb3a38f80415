"""What a run was told and depends on: its configuration and header, and in what two differ."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import msgspec

from karma.errors import FileError
from karma.files import read_json, to_json
from karma.journal.owned_folder import HEADER, benchmark_in, brief, changed, kind_in
from karma.journal.records import NOT_RUN

CONFIG = "config.json"  # in the run folder
Config = Mapping[str, Any]
_PATHS = (  # keys whose values are paths
    "tasks", "types", "trials", "published", "run.states",
)  # fmt: skip
_NAMES = (  # and names or paths, after "KIND:" if any, "+" between several
    "models.planner", "models.profile", "models.embedder", "models.vision",
    "rows.vision",
)  # fmt: skip


def read_config(folder: Path) -> Config | None:
    """Return what a run was told, None where its folder does not say; FileError for a torn file."""
    path = folder / CONFIG
    if not path.exists():
        return None
    found: dict[str, Any] = read_json(path, dict[str, Any])
    rows = found.get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise FileError(path, "no configuration of a run: `rows` is no list of tables")
    if isinstance(models := found.get("models"), dict) and not models.get("rpc"):
        models.pop("rpc", None)  # an option that there was; nothing was said by it
    return found


def told_apart(old: Config, new: Config) -> list[str]:
    """Return in what two configurations differ, their rows aside; where files lie is no difference.

    >>> one = {"models": {"constraint": "types"}, "tasks": "/x/a.jsonl", "rows": []}
    >>> told_apart(one, {"models": {"constraint": "free"}, "tasks": "/y/a.jsonl", "rows": []})
    ['models.constraint: "types" became "free"']
    """
    before, after = ({k: v for k, v in one.items() if k != "rows"} for one in (old, new))
    return _changes(without_places(before), without_places(after))


def rows_apart(old: Config, first: str, new: Config, second: str) -> list[str]:
    """Return in what a row of one run differs from a row of another, its name aside."""
    rows: list[Config] = [
        next((row for row in one["rows"] if row.get("name") == name), {})
        for one, name in ((old, first), (new, second))
    ]
    where = first if first == second else f"{first} -> {second}"
    before, after = ({k: v for k, v in row.items() if k != "name"} for row in rows)
    found = _changes(without_places(before, "rows"), without_places(after, "rows"))
    return [f"row {where}: {words}" for words in found]


def all_apart(old: Config, new: Config) -> list[str]:
    """Return in what two configurations differ, row by row."""
    names = [[str(row.get("name")) for row in one["rows"]] for one in (old, new)]
    both = [name for name in names[0] if name in names[1]]
    found = told_apart(old, new)
    if names[0] != names[1]:
        found.append(f"rows: {', '.join(names[0])} became {', '.join(names[1])}")
    return found + [words for name in both for words in rows_apart(old, name, new, name)]


def _changes(old: Config, new: Config) -> list[str]:
    before, after = dict(_leaves("", old)), dict(_leaves("", new))
    return [
        f"{name}: {before.get(name, 'not said')} became {after.get(name, 'not said')}"
        for name in dict.fromkeys((*before, *after))
        if before.get(name) != after.get(name)
    ]


def _leaves(key: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield each option of a tree with its value as JSON."""
    if isinstance(value, Mapping) and value:
        for name, one in value.items():
            yield from _leaves(f"{key}.{name}".lstrip("."), one)
    else:
        yield key, msgspec.json.encode(value, order="sorted").decode()


# ----------------------------------------------------------------- where files lie


def without_places(tree: Any, key: str = "") -> Any:
    """Return an experiment with the last names of its paths: where files lie decides nothing."""
    return each_path(tree, key, lambda path: Path(path).name)


def each_path(tree: Any, key: str, change: Callable[[str], str]) -> Any:
    """Return a tree with each path changed."""
    if isinstance(tree, Mapping):
        return {
            name: each_path(value, f"{key}.{name}".lstrip("."), change)
            for name, value in tree.items()
        }
    if isinstance(tree, list | tuple):
        return [each_path(value, key, change) for value in tree]
    if not isinstance(tree, str) or not tree:
        return tree
    if key in _PATHS:
        return change(tree)
    if key.startswith("source."):
        return change(tree) if "/" in tree or Path(tree).suffix else tree
    if key in _NAMES:
        kind, colon, name = tree.partition(":")
        if not colon:
            kind, name = "", tree
        return (
            kind
            + colon
            + "+".join(change(one) if _may_lie(one) else one for one in name.split("+"))
        )
    return tree


def _may_lie(name: str) -> bool:
    return "/" in name or name.endswith((".gguf", ".safetensors"))


# ----------------------------------------------------------------- headers

FORMAT = 6  # of the folder; 1 had times among the records, 2 no methods or rooms, 3 no tours,
# 4 no engine and no refused prompts, 5 no goals met at the start and no tasks left unjudged
EPISODES, TIMINGS, RESULTS = "episodes.jsonl", "timings.jsonl", "results.json"
TABLE = "table.md"
CELLS = "cells"  # of the folder of a sweep, as version 0.3.0 wrote it
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
