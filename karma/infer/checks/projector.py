"""Check the picture part of a GGUF pair (mmproj) without llama.cpp, which a damaged one kills.

llama.cpp ends the process where weights or keys that it computes with are missing, and says nothing
of others: without places or norms it loads and computes something else. So for the kinds of
projector that are known here, all of them are looked for. Others are left to a trial.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from karma.errors import ModelError
from karma.infer.checks.gguf import GgufHeader, is_gguf, read_header

_SIZES = (
    "vision.image_size", "vision.patch_size", "vision.embedding_length", "vision.block_count",
    "vision.projection_dim", "vision.attention.head_count",
)  # fmt: skip
_PRESENT = ("vision.feed_forward_length", "vision.attention.layer_norm_epsilon")
_THREE = ("vision.image_mean", "vision.image_std")  # one number per colour
_BLOCK = ("attn_out", "ln1", "ln2", "ffn_up", "ffn_down")


_QWEN = ("v.patch_embd.weight.1", "v.post_ln.weight", "mm.0.weight", "mm.2.weight")
_TENSORS: Mapping[str, Sequence[str]] = {  # of a kind, beside the encoder's blocks
    "mlp": ("v.position_embd.weight", "mm.0.weight"),
    "idefics3": ("v.position_embd.weight", "v.post_ln.weight", "mm.model.fc.weight"),
    "qwen2vl_merger": _QWEN,
    "qwen2.5vl_merger": _QWEN,
}
_NUMBERS = {  # positive ones, likewise
    "idefics3": "vision.projector.scale_factor",
    "qwen2.5vl_merger": "vision.n_wa_pattern",
}


def check_projector(path: Path) -> Mapping[str, Any]:
    """Check header, keys and names of tensors; return the metadata.

    ModelError: not a projector for pictures, cut off, or something that it needs is missing.
    """
    header = read_header(path, sizes=_SIZES)
    metadata = header.metadata
    kind = metadata.get("clip.projector_type", metadata.get("clip.vision.projector_type"))
    if metadata["general.architecture"] != "clip" or not metadata.get("clip.has_vision_encoder"):
        raise ModelError(f"{path}: not a picture projector (mmproj): no clip.has_vision_encoder")
    missing = [key for key in _PRESENT if f"clip.{key}" not in metadata]
    missing += [key for key in _THREE if (metadata.get(f"clip.{key}") or 0) < 3]
    if kind is None:
        missing.append("projector_type")
    if key := _NUMBERS.get(str(kind)):
        number = metadata.get(f"clip.{key}")
        missing += [] if isinstance(number, int) and number > 0 else [key]
    if missing:
        raise ModelError(f"{path}: damaged projector: no usable clip.{missing[0]}")
    if str(kind) in _TENSORS and (lacking := _lacking(header, _TENSORS[str(kind)])):
        raise ModelError(f"{path}: damaged projector of kind {kind!r}: no tensor {lacking[0]}")
    return metadata


def _lacking(header: GgufHeader, tensors: Sequence[str]) -> list[str]:
    wanted = ["v.patch_embd.weight", *tensors]
    for layer in range(header.metadata.get("clip.vision.block_count", 0)):
        fused = f"v.blk.{layer}.attn_qkv.weight" in header.tensors
        parts = ("attn_qkv",) if fused else ("attn_q", "attn_k", "attn_v")
        wanted += [f"v.blk.{layer}.{part}.weight" for part in (*parts, *_BLOCK)]
    return [name for name in wanted if name not in header.tensors]


def split_pair(folder: Path, files: Iterable[Path]) -> tuple[Path, Path]:
    """Return the language part and the projector, told apart by what their headers say.

    ModelError where there are not just these two, or one is damaged.
    """
    weights = [file for file in files if is_gguf(file)]
    projectors = [file for file in weights if is_projector(file)]
    models = [file for file in weights if file not in projectors]
    if len(projectors) != 1 or len(models) != 1:
        raise ModelError(
            f"{folder}: a picture model is two .gguf files, the model and its projector (mmproj); "
            f"here are {len(models)} and {len(projectors)}\n"
            "  To fix: a folder with just these two"
        )
    return models[0], projectors[0]


def is_projector(path: Path) -> bool:
    """Return whether a GGUF is the picture part of another; ModelError where it is damaged."""
    return bool(read_header(path, sizes=()).metadata.get("general.architecture") == "clip")
