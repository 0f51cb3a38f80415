"""A row's options, read strictly into the settings of its method."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from karma.errors import KarmaError, did_you_mean

T = TypeVar("T")


def settings_of(kind: type[T], options: Mapping[str, Any]) -> T:
    """Read a row's options into its settings; KarmaError names one that is unknown or wrong."""
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    if extra := sorted(set(options) - set(known)):
        hint = did_you_mean(extra[0], known)
        raise KarmaError(f"unknown option {extra[0]!r}; known options: {', '.join(known)}.{hint}")
    for key, kind_of in get_type_hints(kind).items():
        if get_origin(kind_of) is Literal and key in options:
            _check_choice(key, options[key], get_args(kind_of))
    try:
        return msgspec.convert(dict(options), kind)
    except msgspec.ValidationError as error:
        raise KarmaError(str(error)) from error


def _check_choice(key: str, value: Any, choices: tuple[Any, ...]) -> None:
    if value not in choices:
        hint = did_you_mean(str(value), map(str, choices))
        raise KarmaError(f"{key} = {value!r}: one of {', '.join(map(repr, choices))}.{hint}")
