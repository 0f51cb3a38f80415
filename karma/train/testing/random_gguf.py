"""Write a GGUF of random weights, one tensor at a time, so that size is bounded by the disk."""

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.errors import FileError
from karma.seeds import stream

Shape = tuple[int, ...]
_DRAWN = 1 << 22  # numbers drawn at once
_BIAS = 0.1
_LOGIT = 3.0  # standard deviation of logits, as in trained models


def write_random_gguf(
    path: str | Path,
    architecture: str,
    fill: Callable[[Any], None],
    tensors: Iterable[tuple[str, Shape]],
    *,
    seed: int,
) -> Path:
    """Write a file of random weights; same seed, same bytes.

    Matrices are F16, drawn evenly with the variance that keeps activations of size one; norms are
    ones and biases small, both F32.

    It appears whole or not at all. `fill` adds the metadata to a `gguf.GGUFWriter`; shapes have
    rows first. FileError if it cannot be written.
    """
    import gguf

    path, listed = Path(path), list(tensors)
    making = path.with_name(f".{path.name}.making")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        writer = gguf.GGUFWriter(making, architecture)
        fill(writer)
        for name, shape in listed:
            kind = _kind(name, shape)
            writer.add_tensor_info(name, shape, kind, math.prod(shape) * kind.itemsize)
        writer.write_header_to_file()
        writer.write_kv_data_to_file()
        writer.write_ti_data_to_file()
        for name, shape in listed:
            writer.write_tensor_data(_random(name, shape, seed))
        writer.close()
        making.replace(path)
    except OSError as error:
        fix = "free some space there, or choose another folder"
        raise FileError(path, f"cannot write: {error.strerror or error}", fix=fix) from error
    finally:
        with suppress(OSError):
            making.unlink()
    return path


def add_keys(
    writer: Any, keys: Iterable[tuple[str, bool | int | float | str | Sequence[Any]]]
) -> None:
    """Add metadata, each value by its Python type: uint32 for int, float32 for float."""
    for key, value in keys:
        match value:
            case bool():
                writer.add_bool(key, value)
            case int():
                writer.add_uint32(key, value)
            case float():
                writer.add_float32(key, value)
            case str():
                writer.add_string(key, value)
            case _:
                writer.add_array(key, list(value))


def _kind(name: str, shape: Shape) -> np.dtype[Any]:
    """Return the type of a tensor; llama.cpp adds vectors and places to activations as they are."""
    whole = len(shape) == 1 or "position_embd" in name
    return np.dtype(np.float32 if whole else np.float16)


def _random(name: str, shape: Shape, seed: int) -> NDArray[Any]:
    """Draw one tensor from a stream of its own."""
    out = np.empty(math.prod(shape), _kind(name, shape))
    if len(shape) == 1 and name.endswith(".weight"):
        out[:] = 1.0
        return out
    generator, reach = (
        stream(seed, "weights", name),
        np.float32(math.sqrt(12) * _deviation(name, shape)),
    )
    for start in range(0, out.size, _DRAWN):
        piece = generator.random(min(_DRAWN, out.size - start), dtype=np.float32)
        piece -= np.float32(0.5)
        piece *= reach
        out[start : start + piece.size] = piece
    return out.reshape(shape)


def _deviation(name: str, shape: Shape) -> float:
    if len(shape) == 1:
        return _BIAS
    fan_in = math.prod(shape[1:])
    return (_LOGIT if name in ("token_embd.weight", "output.weight") else 1.0) / math.sqrt(fan_in)
