"""Make picture models of random weights: a language model and its projector (mmproj), two GGUF."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from karma.errors import UnknownNameError
from karma.train.testing.families import PICTURE_FAMILIES, Size, find_family
from karma.train.testing.planners import make_planner
from karma.train.testing.random_gguf import Shape, add_keys, write_random_gguf

_HIDDEN, _INNER, _LAYERS, _HEADS = 32, 48, 2, 2
_IMAGE, _PATCH, _MERGED = 32, 8, 2  # pixels; pixels; patches on a side that become one token
_PATCHES = (_IMAGE // _PATCH) ** 2
_SQUARE = _HIDDEN * _MERGED**2
_KEYS: Mapping[str, Mapping[str, Any]] = {
    "idefics3": {"projector.scale_factor": _MERGED, "preproc_image_size": _IMAGE},
    "qwen2.5vl_merger": {"spatial_merge_size": _MERGED, "n_wa_pattern": _LAYERS},
    "mlp": {},
}


class MadePair(NamedTuple):
    """The two files of a picture model."""

    model: Path
    projector: Path


def make_picture_model(
    folder: str | Path, family: str = "smolvlm", seed: int = 0, *, size: Size | None = None
) -> MadePair:
    """Write `FAMILY.gguf` and `mmproj-FAMILY.gguf` into a folder, some 250 kB in all.

    A picture of 32 by 32 pixels takes 4 tokens (LLaVA: 16); SmolVLM, Idefics3 and LLaVA scale every
    picture to that, Qwen2.5-VL takes a token per 16 by 16 pixels.

    Same seed, same bytes. UnknownNameError if no such family, or it reads no pictures;
    FileError if a file cannot be written.
    """
    kind = find_family(family).projector
    if kind is None:
        raise UnknownNameError(
            f"model family {family!r} reads no pictures; {', '.join(PICTURE_FAMILIES)} do"
        )
    folder, size = Path(folder), size or Size()
    model = make_planner(folder / f"{family}.gguf", family, seed, size=size)
    projector = folder / f"mmproj-{family}.gguf"

    def fill(writer: Any) -> None:
        writer.add_name(f"random {family} projector")
        add_keys(writer, _keys(kind, size.width))

    write_random_gguf(projector, "clip", fill, _tensors(kind, size.width), seed=seed)
    return MadePair(model, projector)


def _keys(kind: str, width: int) -> Iterator[tuple[str, Any]]:
    yield "clip.has_vision_encoder", True
    yield "clip.projector_type", kind
    keys: dict[str, Any] = {
        "image_size": _IMAGE,
        "patch_size": _PATCH,
        "embedding_length": _HIDDEN,
        "feed_forward_length": _INNER,
        "block_count": _LAYERS,
        "projection_dim": width,
        "attention.head_count": _HEADS,
        "attention.layer_norm_epsilon": 1e-6,
        "image_mean": (0.5, 0.5, 0.5),
        "image_std": (0.5, 0.5, 0.5),
        **_KEYS[kind],
    }
    yield from ((f"clip.vision.{key}", value) for key, value in keys.items())


def _tensors(kind: str, width: int) -> Iterator[tuple[str, Shape]]:
    patch = (_HIDDEN, 3, _PATCH, _PATCH)
    yield "v.patch_embd.weight", patch
    if kind == "qwen2.5vl_merger":  # for two frames in time; places are rotations
        yield "v.patch_embd.weight.1", patch
        yield "v.post_ln.weight", (_HIDDEN,)
        yield from _matrix("mm.0", _SQUARE, _SQUARE)
        yield from _matrix("mm.2", width, _SQUARE)
    elif kind == "idefics3":
        yield "v.patch_embd.bias", (_HIDDEN,)
        yield "v.position_embd.weight", (_PATCHES, _HIDDEN)
        yield from _norm("v.post_ln")
        yield "mm.model.fc.weight", (width, _SQUARE)
    else:  # mlp: CLIP's encoder, one place more for the class
        yield "v.class_embd", (_HIDDEN,)
        yield "v.position_embd.weight", (_PATCHES + 1, _HIDDEN)
        yield from _norm("v.pre_ln")
        yield from _matrix("mm.0", width, _HIDDEN)
        yield from _matrix("mm.2", width, width)
    for layer in range(_LAYERS):
        yield from _block(f"v.blk.{layer}", gated=kind == "qwen2.5vl_merger")


def _block(name: str, *, gated: bool) -> Iterator[tuple[str, Shape]]:
    """Yield one layer of the encoder; Qwen's has a gate, and norms without bias."""
    for part in ("attn_q", "attn_k", "attn_v", "attn_out"):
        yield from _matrix(f"{name}.{part}", _HIDDEN, _HIDDEN)
    for part in ("ln1", "ln2"):
        yield from [(f"{name}.{part}.weight", (_HIDDEN,))] if gated else _norm(f"{name}.{part}")
    yield from _matrix(f"{name}.ffn_up", _INNER, _HIDDEN)
    if gated:
        yield from _matrix(f"{name}.ffn_gate", _INNER, _HIDDEN)
    yield from _matrix(f"{name}.ffn_down", _HIDDEN, _INNER)


def _matrix(name: str, rows: int, columns: int) -> Iterator[tuple[str, Shape]]:
    yield f"{name}.weight", (rows, columns)
    yield f"{name}.bias", (rows,)


def _norm(name: str) -> Iterator[tuple[str, Shape]]:
    yield f"{name}.weight", (_HIDDEN,)
    yield f"{name}.bias", (_HIDDEN,)
