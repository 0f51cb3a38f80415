"""A look at a folder of safetensors and JSON before transformers sees it.

Only headers and configurations are read: no weights, no code, nothing pickled.
"""

import json
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

from karma.errors import ModelError

PICKLES = (".bin", ".pt", ".pth", ".pkl", ".pickle", ".ckpt", ".npy", ".msgpack", ".h5")
_MOST_HEADER = 100_000_000  # bytes, as the safetensors library has it
_MOST_CONFIG = 50_000_000
_BITS = {
    "F64": 64, "I64": 64, "U64": 64, "F32": 32, "I32": 32, "U32": 32, "F16": 16, "BF16": 16,
    "I16": 16, "U16": 16, "F8_E4M3": 8, "F8_E5M2": 8, "F8_E8M0": 8, "I8": 8, "U8": 8, "BOOL": 8,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """What the headers of a folder's safetensors say."""

    files: tuple[Path, ...]
    sizes: Mapping[str, int] = field(repr=False)  # parameters by the name of their tensor

    @property
    def parameters(self) -> int:
        """How many numbers there are."""
        return sum(self.sizes.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedFolder:
    """A folder that an adapter can open."""

    path: Path
    model_type: str
    config: Mapping[str, Any]
    weights: Weights


def check_folder(
    folder: Path,
    families: Mapping[str, Collection[str]],
    *,
    needs: Sequence[Sequence[str]] = (),
    fix: str = "bring the model's whole folder and run `karma models add FOLDER`",
) -> CheckedFolder:
    """Check a model folder: architecture first, then processor files, then headers of the weights.

    Args:
        folder: holds config.json and model.safetensors, or shards with their index.
        families: `model_type` -> architectures that will do, as config.json has it; () = any.
        needs: groups of files; of every group at least one must be there.
        fix: what the message tells to do about a missing file.

    Raises:
        ModelError: not a folder, the wrong architecture, a file missing, or a header damaged.
    """
    if not folder.is_dir():
        raise ModelError(f"{folder}: no such folder\n  To fix: {fix}")
    config = read_config(folder / "config.json", fix=fix)
    model_type = str(config.get("model_type"))
    if model_type not in families:
        wanted = ", ".join(sorted(families))
        raise ModelError(
            f"{folder / 'config.json'}: model_type is {model_type!r}, this adapter opens {wanted}"
        )
    named = config.get("architectures") or ()
    if not isinstance(named, list | tuple) or not all(isinstance(one, str) for one in named):
        raise ModelError(f"{folder / 'config.json'}: architectures is {named!r}, not a list")
    if named and families[model_type] and not set(named) & set(families[model_type]):
        wanted = ", ".join(sorted(families[model_type]))
        raise ModelError(
            f"{folder / 'config.json'}: architecture {', '.join(map(str, named))}, "
            f"this adapter opens {wanted}"
        )
    for group in needs:
        if not any((folder / name).is_file() for name in group):
            raise ModelError(f"{folder}: no {' nor '.join(group)}\n  To fix: {fix}")
    weights = check_weights(folder, fix=fix)
    return CheckedFolder(path=folder, model_type=model_type, config=config, weights=weights)


def read_config(path: Path, *, fix: str) -> Mapping[str, Any]:
    """Read a JSON object of a model folder.

    Raises:
        ModelError: missing, huge, torn, or not an object.
    """
    try:
        if path.stat().st_size > _MOST_CONFIG:
            raise ModelError(
                f"{path}: {path.stat().st_size} bytes are too many for a configuration"
            )
        found = json.loads(path.read_bytes())
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}\n  To fix: {fix}") from error
    except (ValueError, RecursionError) as error:
        raise ModelError(f"{path}: not JSON: {error}\n  To fix: {fix}") from error
    if not isinstance(found, dict):
        raise ModelError(f"{path}: not a JSON object\n  To fix: {fix}")
    return found


def whole_number(path: Path, config: Mapping[str, Any], *keys: str, default: int) -> int:
    """Return the positive number at `keys`, one inside the other; `default` where it is not said.

    Raises:
        ModelError: something else stands there; names `path`, the file.
    """
    found: Any = config
    for key in keys:
        if not isinstance(found, dict):
            break
        found = found.get(key)
        if found is None:
            return default
    if not isinstance(found, int) or isinstance(found, bool) or found < 1:
        raise ModelError(f"{path}: {'.'.join(keys)} is {found!r}, not a positive number")
    return found


def check_weights(folder: Path, *, fix: str) -> Weights:
    """Check the safetensors of a folder: model.safetensors, or all shards its index names.

    Raises:
        ModelError: there are none (pickles are refused by name), one is missing or damaged.
    """
    files = _weight_files(folder, fix)
    sizes: dict[str, int] = {}
    for file in files:
        sizes.update(check_safetensors(file))
    return Weights(files=files, sizes=sizes)


def check_safetensors(path: Path) -> Mapping[str, int]:
    """Read the header of one safetensors file and check that every tensor lies inside it.

    Returns:
        How many parameters each tensor has, by its name.

    Raises:
        ModelError: not a safetensors file, cut off, or with sizes that make no sense.
    """
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            (length,) = struct.unpack("<Q", file.read(8))
            if not 2 <= length <= min(_MOST_HEADER, size - 8):
                raise ValueError(f"a header of {length} bytes in a file of {size}")
            header = json.loads(file.read(length))
        return _sizes(header, size - 8 - length)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, struct.error, RecursionError) as error:
        reason = f"damaged or not safetensors: {error}"
        raise ModelError(f"{path}: {reason}") from error


def _sizes(header: Any, room: int) -> Mapping[str, int]:
    if not isinstance(header, dict):
        raise ValueError("its header is no JSON object")
    found: dict[str, int] = {}
    for name, tensor in header.items():
        if name == "__metadata__":
            continue
        kind, shape, (begin, end) = tensor["dtype"], tensor["shape"], tensor["data_offsets"]
        if not all(isinstance(extent, int) and extent >= 0 for extent in (*shape, begin, end)):
            raise ValueError(f"tensor {name!r} has impossible sizes")
        if kind not in _BITS:
            raise ValueError(f"tensor {name!r} has unknown type {kind!r}")
        if end - begin != prod(shape) * _BITS[kind] // 8:
            raise ValueError(f"tensor {name!r} has {end - begin} bytes for shape {shape}")
        if end > room:
            raise ValueError(f"tensor {name!r} ends at byte {end} of {room} (cut off?)")
        found[str(name)] = prod(shape)
    if not found:
        raise ValueError("no tensors")
    return found


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
