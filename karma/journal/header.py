"""What the records of a run depend on, and in what two runs differ."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import msgspec

from karma.errors import FileError
from karma.files import read_json
from karma.journal.folder import HEADER

FORMAT = 7  # of the folder; another one is refused
Kind = Literal["run", "benchmark", "figure", "talk"]
Options = Mapping[str, Any]
_WAITING = ("timeout_s", "retries")  # of an endpoint: a request that is given up leaves no record
_SELECTING = ("only", "limit")  # of our tasks: what they select stands in `files`

_PATHS = (  # keys whose values are paths
    "tasks", "types", "trials", "published",
)  # fmt: skip
_NAMES = (  # and names or paths, after "KIND:" if any, "+" between several
    "models.planner", "models.profile", "models.embedder", "models.vision",
    "rows.vision",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """Where a run was begun; decides nothing."""

    platform: str
    cpu: str
    cores: int
    threads: int  # of each planner
    devices: tuple[str, ...] = ()  # that llama.cpp can compute on, as it names and describes them


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What the records of a run depend on; a folder never mixes two."""

    format: int = FORMAT
    kind: Kind = "run"
    name: str  # of the experiment
    options: Options  # all that the experiment says, with what it leaves to defaults
    files: Mapping[str, str]  # tasks and lists: name -> SHA-256
    versions: Mapping[str, str]  # of this package and of what computes
    models: Mapping[str, str] = field(default_factory=dict)  # role -> name and SHA-256
    prompts: Mapping[str, str] = field(default_factory=dict)  # template -> SHA-256
    scenes: Mapping[str, str] = field(default_factory=dict)  # name -> SHA-256
    network: bool = False  # started with --allow-network
    steps: bool = False  # whether step logs are kept
    machine: Machine | None = field(default=None, compare=False)

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a header; FileError if there is none, or another version wrote it."""
        if kind_in(folder) is None:
            fix = "karma eval FILE --out FOLDER"
            raise FileError(folder / HEADER, "there is no run in this folder", fix=fix)
        return read_json(folder / HEADER, cls)

    def apart(self, new: "Header") -> list[str]:
        """Return in what another header differs, in words."""
        old, now = (
            {"kind": one.kind, "name": one.name, "network": str(one.network),
             "step logs": str(one.steps)}
            for one in (self, new)
        )  # fmt: skip
        options = options_apart(self.options, new.options)
        return [*changed("run", old, now), *options, *self.inputs_apart(new)]

    def inputs_apart(self, new: "Header") -> list[str]:
        """Return which files, versions, models, prompts and scenes differ."""
        return [
            words
            for what in ("files", "versions", "models", "prompts", "scenes")
            for words in changed(what, getattr(self, what), getattr(new, what))
        ]


class _Peek(msgspec.Struct, frozen=True):
    """What headers of all versions may have."""

    format: int = 0
    kind: Kind = "run"
    version: str = ""
    versions: dict[str, str] = {}


def kind_in(folder: Path) -> Kind | None:
    """Return what kind of run a folder holds, or None; FileError if another version wrote it."""
    if not (folder / HEADER).exists():
        return None
    peek = read_json(folder / HEADER, _Peek)
    if peek.format != FORMAT:
        version = peek.versions.get("karma", peek.version)
        reason = f"written by KARMA {version}, in a form that this version does not read"
        fix = "read it with that version, or run the experiment again: karma eval FILE --fresh"
        raise FileError(folder / HEADER, reason.replace("KARMA ,", "an earlier KARMA,"), fix=fix)
    return peek.kind


def changed(what: str, before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return in what two sets of named texts, such as hashes, differ, in words.

    >>> changed("models", {"planner": "a"}, {"planner": "b", "vision": "c"})
    ['models: planner: a became b', 'models: vision: none became c']
    """
    return [
        f"{what}: {name}: {_brief(before.get(name))} became {_brief(after.get(name))}"
        for name in sorted({*before, *after})
        if before.get(name) != after.get(name)
    ]


def _brief(text: str | None) -> str:
    """Return a name with a hash short enough to be read."""
    return "none" if text is None else re.sub(r"\b([0-9a-f]{12})[0-9a-f]{52}\b", r"\1", text)


# ----------------------------------------------------------------- options


def options_apart(old: Options, new: Options) -> list[str]:
    """Return in what two experiments differ, row by row; where files lie is no difference.

    >>> first = {"models": {"constraint": "types"}, "tasks": "/x/a.jsonl", "rows": []}
    >>> options_apart(first, {"models": {"constraint": "free"}, "tasks": "/y/a.jsonl", "rows": []})
    ['models.constraint: "types" became "free"']
    """
    names = [list(_rows(one)) for one in (old, new)]
    found = shared_apart(old, new)
    if names[0] != names[1]:
        found.append(f"rows: {', '.join(names[0])} became {', '.join(names[1])}")
    both = [name for name in names[0] if name in names[1]]
    return found + [words for name in both for words in rows_apart(old, name, new, name)]


def shared_apart(old: Options, new: Options) -> list[str]:
    """Return in what two experiments differ, without their rows."""
    left_out = ("rows", *(() if "benchmark" in old else _SELECTING))
    before, after = ({k: v for k, v in one.items() if k not in left_out} for one in (old, new))
    return _changes(before, after)


def rows_apart(old: Options, first: str, new: Options, second: str) -> list[str]:
    """Return in what a row of one run differs from a row of another, without its name."""
    before, after = (_rows(one).get(name, {}) for one, name in ((old, first), (new, second)))
    where = first if first == second else f"{first} -> {second}"
    return [f"row {where}: {words}" for words in _changes(before, after, "rows")]


def _rows(options: Options) -> dict[str, Options]:
    rows: list[Options] = [row for row in options.get("rows", ()) if isinstance(row, Mapping)]
    return {str(row["name"]): {k: v for k, v in row.items() if k != "name"} for row in rows}


def _changes(old: Options, new: Options, key: str = "") -> list[str]:
    before, after = (dict(_leaves("", without_places(one, key))) for one in (old, new))
    return [
        f"{name}: {before.get(name, 'not said')} became {after.get(name, 'not said')}"
        for name in dict.fromkeys((*before, *after))
        if before.get(name) != after.get(name)
    ]


def _leaves(key: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield each option of a tree with its value as JSON."""
    if isinstance(value, Mapping) and value:
        for name, part in value.items():
            if not (name in _WAITING and "hosted" in key):
                yield from _leaves(f"{key}.{name}".lstrip("."), part)
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
