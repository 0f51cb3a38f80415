"""Make GGUF models of random weights, one tensor at a time, so that size is bounded by the disk.

Language models have any family's architecture, or are a Llama of any size; picture models are a
language model and its projector (mmproj).
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.agent.planning.prompt import render, skills_of
from karma.errors import FileError, UnknownNameError
from karma.household.types import object_types
from karma.models.llama.gguf_files import add_special_tokens, add_vocabulary, new_tokenizer
from karma.seeds import stream
from karma.testing.families import (
    PICTURE_FAMILIES,
    Family,
    Shape,
    Size,
    find_family,
    language_keys,
    language_tensors,
)
from karma.types.planning import PlanRequest

TRAINED = 1200  # tokens, the family's own among them


def make_planner(
    path: str | Path, family: str = "llama3", seed: int = 0, *, size: Size | None = None
) -> Path:
    """Write a language model with the architecture, control tokens and template of a family.

    It babbles. By default it takes some 150 kB and a few hundredths of a second.

    Same seed, same bytes. UnknownNameError if no such family; FileError if it cannot be
    written.
    """
    chosen, size = find_family(family), size or Size()

    def fill(writer: Any) -> None:
        writer.add_name(f"random {family}")
        writer.add_description("Random weights: for tests and measurements of speed")
        add_keys(writer, language_keys(chosen.architecture, size))
        _add_words(writer, chosen, size.vocabulary)

    tensors = language_tensors(chosen.architecture, size)
    return write_random_gguf(path, chosen.architecture, fill, tensors, seed=seed)


def _add_words(writer: Any, family: Family, vocabulary: int) -> None:
    tokenizer = make_tokenizer(family, vocabulary)
    add_vocabulary(writer, tokenizer, vocabulary, pre=family.pre)
    ends = {"bos": family.bos, "eos": family.eos}
    add_special_tokens(writer, tokenizer, ends, add_bos=family.add_bos)
    writer.add_chat_template(family.template)


@lru_cache(maxsize=32)
def make_tokenizer(family: Family, vocabulary: int = TRAINED) -> Any:
    """Return a `tokenizers.Tokenizer` whose ids begin with the family's control tokens.

    It has no more tokens than the model's vocabulary, and no more than `TRAINED`.
    """
    from tokenizers import AddedToken

    tokenizer = new_tokenizer(
        _texts(), min(vocabulary, TRAINED) - len(family.added), family.control
    )
    tokenizer.add_tokens([AddedToken(text, special=False) for text in family.added])
    return tokenizer


def _texts() -> Iterable[str]:
    """Yield what planners read and write, so that a prompt takes few tokens."""
    request = PlanRequest(instruction="put the apple in the fridge")
    yield render("full", request).prompt.stable
    yield from ["\n\n"] * 50  # a token: llama.cpp puts it before pictures of Idefics 3
    for thing in object_types():
        yield from (f"{skill.name}(robot, '{thing}')\n" for skill in skills_of("full"))
        yield f"Explore(robot, '{thing}', ['node_1', 'node_2'])\n"


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
    """Return the type of a tensor; llama.cpp takes some only in the precision of activations."""
    whole = len(shape) == 1 or any(part in name for part in ("position_embd", "conv", "ssm_a"))
    whole = whole and "_proj" not in name
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
        out[start : start + piece.size] = -abs(piece) if name.endswith("ssm_a") else piece
    return out.reshape(shape)


def _deviation(name: str, shape: Shape) -> float:
    if len(shape) == 1:
        return _BIAS
    fan_in = math.prod(shape[1:])
    return (_LOGIT if name in ("token_embd.weight", "output.weight") else 1.0) / math.sqrt(fan_in)


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
