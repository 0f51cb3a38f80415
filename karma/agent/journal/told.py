"""What a run was told, every option with its value, and in what two runs differ."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from karma.agent.loading.planner_files import NO_WORDS
from karma.errors import FileError
from karma.files import read_json

CONFIG = "config.json"  # in the run folder
Config = Mapping[str, Any]
_PATHS = (  # keys whose values are paths
    "tasks", "authors", "scenes", "layouts", "types", "trials", "published", "alfred.trials",
    "alfred.lists", "alfred.training", "models.words", "run.states",
)  # fmt: skip
_NAMES = (  # and names or paths, after "KIND:" if any, "+" between several
    "models.planner", "models.profile", "models.embedder", "models.vision", "models.detector",
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
        return tree if key == "models.words" and tree == NO_WORDS else change(tree)
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
