"""Check safetensors and JSON files of a model folder by their headers.

Only headers and configurations are read: no weights, no code, nothing pickled.
"""

import json
from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

from karma.errors import FileError, ModelError
from karma.files import open_regular, read_bytes

PICKLES = (".bin", ".pt", ".pth", ".pkl", ".pickle", ".ckpt", ".npy", ".msgpack", ".h5")
_MOST_CONFIG = 50_000_000  # bytes


def read_config(path: Path, *, fix: str) -> Mapping[str, Any]:
    """Read a JSON object of a model folder; ModelError if missing, huge, torn, or not an object."""
    try:
        found = json.loads(read_bytes(path, most=_MOST_CONFIG))
    except FileError as error:
        raise ModelError(f"{path}: {error.reason}\n  To fix: {fix}") from error
    except (ValueError, RecursionError) as error:
        raise ModelError(f"{path}: not JSON: {error}\n  To fix: {fix}") from error
    if not isinstance(found, dict):
        raise ModelError(f"{path}: not a JSON object\n  To fix: {fix}")
    return found


def check_weights(folder: Path, *, fix: str) -> Mapping[str, int]:
    """Return parameters by tensor of model.safetensors, or of all shards that its index names.

    Raises:
        ModelError: there are none (pickles are refused by name), one is missing or damaged.
    """
    sizes: dict[str, int] = {}
    for file in _weight_files(folder, fix):
        sizes.update(check_safetensors(file))
    return sizes


def check_safetensors(path: Path) -> Mapping[str, int]:
    """Return parameters by tensor of a safetensors file, by its header; ModelError: damaged."""
    from safetensors import SafetensorError, safe_open

    try:
        open_regular(path).close()
        with safe_open(path, framework="numpy") as file:
            sizes = {name: prod(file.get_slice(name).get_shape()) for name in sorted(file.keys())}
    except FileError as error:
        raise ModelError(f"{path}: {error.reason}") from error
    except (SafetensorError, OSError, ValueError, OverflowError, TypeError) as error:
        raise ModelError(f"{path}: damaged or not safetensors (cut off?): {error}") from error
    if not sizes:
        raise ModelError(f"{path}: damaged or not safetensors: no tensors")
    return sizes


def _weight_files(folder: Path, fix: str) -> tuple[Path, ...]:
    whole, index = folder / "model.safetensors", folder / "model.safetensors.index.json"
    if whole.is_file():
        return (whole,)
    if not index.is_file():
        pickled = sorted(p.name for p in folder.glob("*") if p.suffix in PICKLES)
        why = f"; {pickled[0]} is not opened: it may hold code" if pickled else ""
        raise ModelError(f"{folder}: no model.safetensors{why}\n  To fix: {fix}")
    names = read_config(index, fix=fix).get("weight_map")
    if not isinstance(names, dict) or not names:
        raise ModelError(f"{index}: no weight_map\n  To fix: {fix}")
    shards = sorted({str(name) for name in names.values()})
    for name in shards:
        if Path(name).name != name or not name.endswith(".safetensors"):
            raise ModelError(f"{index}: {name!r} is not a safetensors file of this folder")
        if not (folder / name).is_file():
            raise ModelError(f"{folder / name}: missing, {index.name} names it\n  To fix: {fix}")
    return tuple(folder / name for name in shards)
