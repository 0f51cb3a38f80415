"""Check the arguments of an action: plain, finite values that fit the handler's annotations."""

import math
from collections.abc import Mapping
from types import NoneType, UnionType
from typing import Any, TypedDict, get_args, get_origin, is_typeddict

import msgspec
import numpy as np

from karma.world.core.state import Refusal

_MOST = 3.4e38  # AI2-THOR's numbers are 32 bits wide
_MOST_WHOLE = 2**31
_DEEPEST = 8  # lists within lists
_SCALARS = (str, int, float, bool, NoneType)


class Place(TypedDict, total=False):
    """AI2-THOR's vector: metres, or degrees."""

    x: float
    y: float
    z: float


class _Odd(Exception):
    """A value that AI2-THOR's message format has no place for; says which."""


def kinds(annotation: Any) -> tuple[type, ...]:
    """Return the types that an annotation admits, without their parameters."""
    parts = get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
    return tuple(dict if is_typeddict(part) else get_origin(part) or part for part in parts)


def fit(action: str, name: str, value: Any, annotation: Any, admitted: tuple[type, ...]) -> Any:
    """Return a value as a handler takes it, or a Refusal that says what is wrong with it.

    As in AI2-THOR's player a wrong number or text is misuse, which raises in the client, while a
    vector or list of the wrong form is a failure of the action. `admitted` are the annotation's
    `kinds`.
    """
    try:
        value = _as_json(value)
        if name == "rotation" and dict in admitted and isinstance(value, int | float):
            value = {"y": value}  # as the client does
        if int in admitted and isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= _MOST_WHOLE:
            value = float(value)
        return msgspec.convert(value, annotation)
    except _Odd as odd:
        return _misfit(action, name, str(odd), admitted)
    except msgspec.ValidationError as error:
        if all(kind in _SCALARS for kind in admitted):
            return _misfit(action, name, ascii(value)[:200], admitted)
        text = f"JsonSerializationException: Error converting the argument {name} of {action}"
        return Refusal(f"{text}: {error}", "UnhandledException")


def _misfit(action: str, name: str, shown: str, admitted: tuple[type, ...]) -> Refusal:
    wanted = " or ".join(kind.__name__ for kind in admitted if kind is not NoneType)
    text = f"action: {action} has an invalid argument: {name} (=={shown})."
    return Refusal(f"{text} Cannot convert to: {wanted}", "InvalidArgument")


def _as_json(value: Any, depth: int = 0) -> Any:
    """Return the value in JSON's types; numpy's are welcome, as in the client.

    Raises:
        _Odd: not a number, infinite, too large for AI2-THOR, too deep, half a character, or no
            JSON at all.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool | NoneType):
        return value
    if isinstance(value, int | float):
        if not -_MOST <= value <= _MOST or math.isnan(value):
            raise _Odd(value if isinstance(value, float) else "a number of too many digits")
        return value
    if depth < _DEEPEST:
        if isinstance(value, Mapping):
            return {_text(str(key)): _as_json(inner, depth + 1) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [_as_json(inner, depth + 1) for inner in value]
        raise _Odd(type(value).__name__)
    raise _Odd(f"lists more than {_DEEPEST} deep")


def _text(value: str) -> str:
    """Return a text that can be written as UTF-8."""
    if any("\ud800" <= letter <= "\udfff" for letter in value):
        raise _Odd(ascii(value)[:200])
    return str(value)
