"""A row's options, read strictly into the settings of its method."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import msgspec

from karma.errors import KarmaError

T = TypeVar("T")


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
