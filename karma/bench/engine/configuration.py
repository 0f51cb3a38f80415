"""What an experiment says, with all that it leaves open, and what its records depend on."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from karma import registry
from karma.agent.journal.header import Header
from karma.agent.journal.provenance import header_of as journal_header
from karma.agent.journal.told import Config
from karma.agent.loading.models import PRESETS, Models, Row, preset
from karma.agent.loading.planner_files import NO_WORDS, chosen_words, may_refuse
from karma.bench.engine.experiment import Experiment, RunOptions
from karma.contracts import Task
from karma.infer.manifest.manifest import resolve_planner


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


def header_of(
    experiment: Experiment, tasks: Iterable[Task], scenes: Mapping[str, bytes], *, steps: bool
) -> Header:
    """Return what a run of an experiment depends on.

    Args:
        experiment: as it was read; a comment in its file changes nothing.
        tasks: those that it selects.
        scenes: imported floor plans, by name.
        steps: whether step logs are kept.

    Raises:
        ModelError: a model's file is missing.
        UnknownNameError: there is no such model.
    """
    told = msgspec.to_builtins(msgspec.structs.replace(experiment, run=RunOptions()))
    for name in ("half_width", "max_seeds"):  # how many episodes there are, not what is in one
        del told[name]
    for name in ("only", "limit", "grid"):  # what they select stands in `tasks`
        del told[name]
    for endpoint in filter(None, told["models"]["hosted"].values()):
        for name in ("timeout_s", "retries"):  # a request that is given up leaves no record
            del endpoint[name]
    return journal_header(
        experiment.name, told, experiment.models,
        rows=experiment.rows, tasks=tasks, scenes=scenes, steps=steps,
    )  # fmt: skip
