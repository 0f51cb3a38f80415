"""What methods are made of: the models and folders that a run has loaded once."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from karma.agent.planner import Planner
from karma.contracts import Embedder, Recall, VisionModel
from karma.errors import KarmaError

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Kit:
    """Loaded parts, shared by all rows of a run."""

    planner: Planner
    recall: Recall
    vision: VisionModel
    maps: Path | None = None  # folder of long-term memories
    learn: bool = False  # write what episodes learn back to it
    embedder: Embedder | None = None  # of texts, e.g. to find examples by their instructions


def settings_of(kind: type[T], options: Mapping[str, Any]) -> T:
    """Return a settings dataclass from a row's options, refusing what it does not know.

    Raises:
        KarmaError: an option is unknown or of the wrong type; names it and the known ones.
    """
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    if extra := sorted(set(options) - set(known)):
        raise KarmaError(f"unknown option {extra[0]!r}; known options: {', '.join(known)}")
    try:
        return msgspec.convert(dict(options), kind)
    except msgspec.ValidationError as error:
        raise KarmaError(str(error)) from error
