"""What a run was told, every option with its value, and in what two runs differ."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from karma import registry
from karma.bench.experiment import Models, Row
from karma.bench.experiment_file import without_places
from karma.bench.planner_doubt import may_refuse
from karma.bench.planner_words import NO_WORDS, chosen_words
from karma.bench.presets import PRESETS, preset
from karma.errors import FileError
from karma.files import read_json
from karma.infer.manifest.manifest import resolve_planner

CONFIG = "config.json"  # in the run folder
Config = Mapping[str, Any]


def configuration(experiment: msgspec.Struct) -> Config:
    """Return all that an experiment says, with what it leaves to presets, models and methods.

    Raises:
        ModelError: a model's file is missing.
        UnknownNameError: there is no such model, or method.
    """
    plain: dict[str, Any] = msgspec.to_builtins(experiment)
    models: Models = experiment.models  # type: ignore[attr-defined]
    plain["models"] |= _settled(models)
    rows: tuple[msgspec.Struct, ...] = experiment.rows  # type: ignore[attr-defined]
    for row, said in zip(rows, plain["rows"], strict=True):
        if isinstance(row, Row):
            said |= _row(row, models)
    return plain


def _settled(models: Models) -> dict[str, Any]:
    """Return what is left to the planner's own entry."""
    if models.hosted.planner is not None:
        words = models.words or NO_WORDS
        return {
            "profile": models.profile or "full",
            "refusing": bool(models.refusing),
            "words": words,
        }
    file = resolve_planner(models.planner)
    return {
        "profile": models.profile or file.prompt_profile,
        "chat": file.chat if models.chat is None else models.chat,
        "refusing": may_refuse(models.planner, models.refusing),
        "words": str(chosen_words(models.planner, models.words) or NO_WORDS),
    }


def _row(row: Row, models: Models) -> dict[str, Any]:
    """Return what a row leaves to its preset, its method and [models]."""
    chosen, recall, text = preset(row.preset), models.recall, models.recall_text
    if row.preset:
        recall, text = chosen.recall, chosen.recall_text
    if row.recall:
        recall, text = row.recall, PRESETS[""].recall_text
    kind = getattr(registry.load("methods", row.method), "settings_kind", None)
    defaults = {} if kind is None else msgspec.to_builtins(kind())
    return {
        "recall": recall,
        "recall_text": text,
        "vision": row.vision or models.vision,
        "options": {**defaults, **row.all_options},
    }


# ----------------------------------------------------------------- two runs


def read_config(folder: Path) -> Config | None:
    """Return what a run was told; None where its folder does not say.

    Raises:
        FileError: the file is torn.
    """
    path = folder / CONFIG
    if not path.exists():
        return None
    found: dict[str, Any] = read_json(path, dict[str, Any])
    rows = found.get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise FileError(path, "no configuration of a run: `rows` is no list of tables")
    return found


def told_apart(old: Config, new: Config) -> list[str]:
    """Return in what two configurations differ, their rows aside; where files lie is no difference.

    >>> one = {"models": {"constrained": True}, "tasks": "/x/a.jsonl", "rows": []}
    >>> told_apart(one, {"models": {"constrained": False}, "tasks": "/y/a.jsonl", "rows": []})
    ['models.constrained: true became false']
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
