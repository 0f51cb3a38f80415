"""Merge a LoRA adapter into the GGUF that it was trained on: one file, the same bytes everywhere.

Each product B A is summed rank by rank in float32, so no library's order of additions is in it; the
matrices that change become Q8_0, all else stays as it is, to the byte.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from karma.errors import FileError, ModelError
from karma.files import read_bytes
from karma.infer.checks.template import TEMPLATE
from karma.infer.llama.gguf_files import gguf_reader, interleave, write_gguf
from karma.infer.manifest.manifest import ModelEntry, check_file, file_paths, find_model, verify

_PREFIX = "base_model.model."  # of peft's names
_A, _B = ".lora_A.weight", ".lora_B.weight"
Floats = NDArray[np.float32]


def make_merged(
    entry: ModelEntry, *, progress: Callable[[float], None] = lambda share: None
) -> Path:
    """Make the file of a model that is another one with an adapter, and check its hash.

    The entry's files are what is made, the adapter and its config; `progress` hears the share done.

    Raises:
        ModelError: the base or the adapter is not here or not right, or what was made is not what
            the manifest names.
        FileError: it cannot be written.
    """
    (base,) = verify(find_model(entry.base))
    places = file_paths(entry)
    made, adapter, config = places[:3]
    for file, place in zip(entry.files[1:], places[1:], strict=True):
        check_file(place, file.sha256, size=file.bytes, restore="git checkout -- models")
    merge_adapter(base, adapter, config, made, name=entry.name, progress=progress)
    try:
        check_file(made, entry.files[0].sha256, size=entry.files[0].bytes)
    except ModelError:
        made.unlink()
        raise
    return made


class AdapterConfig(msgspec.Struct, frozen=True):
    """What peft's adapter_config.json says of an adapter; other keys are left alone."""

    r: int
    lora_alpha: float
    use_rslora: bool = False
    use_dora: bool = False


def merge_adapter(
    base: Path,
    adapter: Path,
    config: Path,
    out: Path,
    *,
    name: str,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Write base and adapter as one GGUF; it appears whole or not at all.

    The base is of llama or qwen2; adapter and config are peft's; `progress` hears the share done.

    Raises:
        FileError: one cannot be read, or the file cannot be written.
        ModelError: the adapter does not fit the base.
    """
    import gguf

    reader = gguf_reader(base)
    said = {key: field.contents() for key, field in reader.fields.items()}
    kind = said["general.architecture"]
    changes = _changes(adapter, config, kind, said)
    names = {tensor.name for tensor in reader.tensors}
    if lost := sorted(changes.keys() - names):
        raise ModelError(f"{adapter} changes {lost[0]}, which {base} has not")

    def fill(writer: Any) -> None:
        _copy_fields(writer, reader, name)
        for number, tensor in enumerate(reader.tensors):
            progress(number / len(reader.tensors))
            change = changes.get(tensor.name)
            if change is None:
                writer.add_tensor(tensor.name, tensor.data, raw_dtype=tensor.tensor_type)
                continue
            rows = gguf.quants.dequantize(tensor.data, tensor.tensor_type)
            rows = _added(rows, *change)
            q8 = gguf.GGMLQuantizationType.Q8_0
            writer.add_tensor(tensor.name, gguf.quants.quantize(rows, q8), raw_dtype=q8)

    write_gguf(out, fill, kind)


def _changes(
    adapter: Path, config: Path, kind: str, said: Mapping[str, Any]
) -> dict[str, tuple[Floats, Floats]]:
    """Return GGUF tensor -> (B times its scale, A), rows in the base's order."""
    import gguf
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        read = msgspec.json.decode(read_bytes(config), type=AdapterConfig)
        parts = {key: value.astype(np.float32) for key, value in load(read_bytes(adapter)).items()}
    except (msgspec.DecodeError, SafetensorError) as error:
        raise FileError(adapter, f"no adapter of peft's: {error}") from error
    if read.use_rslora or read.use_dora:
        raise ModelError(f"{config}: rsLoRA and DoRA cannot be merged")
    arch = next(a for a, text in gguf.MODEL_ARCH_NAMES.items() if text == kind)
    table = gguf.get_tensor_name_map(arch, said[f"{kind}.block_count"])
    heads = {
        "attn_q": said[f"{kind}.attention.head_count"],
        "attn_k": said[f"{kind}.attention.head_count_kv"],
    }
    scale = np.float32(read.lora_alpha / read.r)
    found = {}
    for key in sorted(key for key in parts if key.endswith(_A)):
        own = key.removeprefix(_PREFIX).removesuffix(_A)
        name = table.get_name(f"{own}.weight", try_suffixes=(".weight",))
        if name is None:
            raise ModelError(f"{adapter}: {own} has no place in a GGUF")
        wide = parts[key.removesuffix(_A) + _B] * scale
        part = name.split(".")[-2]
        if kind == "llama" and part in heads:
            wide = interleave(wide, heads[part])
        found[name] = (wide, parts[key])
    return found


def _added(rows: Floats, wide: Floats, low: Floats) -> Floats:
    """Return rows + wide @ low, added rank by rank."""
    if rows.shape != (len(wide), low.shape[1]):
        raise ModelError(f"the adapter has {len(wide)} x {low.shape[1]}, the base {rows.shape}")
    found = np.array(rows, np.float32)
    for column, row in zip(wide.T, low, strict=True):
        found += column[:, None] * row
    return found


def _copy_fields(writer: Any, reader: Any, name: str) -> None:
    """Copy what the base says of itself, with another name and without its chat template.

    For who is tuned is asked in the way of its examples.
    """
    import gguf

    left = ("GGUF.", "general.architecture", "general.name", "general.file_type", TEMPLATE)
    for field in reader.fields.values():
        if not field.name.startswith(left):
            kind = field.types[0]
            inner = field.types[-1] if kind == gguf.GGUFValueType.ARRAY else None
            writer.add_key_value(field.name, field.contents(), kind, sub_type=inner)
    writer.add_name(name)
    writer.add_file_type(gguf.LlamaFileType.MOSTLY_Q8_0)
