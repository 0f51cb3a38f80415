"""Read a GGUF of `gguf_export` back: its tokenizer, and its weights into a Llama in PyTorch."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.errors import FileError, ModelError
from karma.infer.llama.gguf_export import bare_tokenizer


def read_gguf_tokenizer(path: Path) -> Any:
    """Return the byte-level BPE `tokenizers.Tokenizer` of a GGUF; every token keeps its id.

    Raises:
        FileError: no such file, or no GGUF with such a tokenizer.
    """
    import gguf
    from tokenizers import AddedToken

    fields = gguf_reader(path).fields
    try:
        tokens, kinds, merges, pre = (
            fields[f"tokenizer.ggml.{name}"].contents()
            for name in ("tokens", "token_type", "merges", "pre")
        )
    except KeyError as error:
        raise FileError(path, f"no {error.args[0]} in it") from error
    own = gguf.TokenType.USER_DEFINED
    vocabulary = {
        text: place
        for place, (text, kind) in enumerate(zip(tokens, kinds, strict=True))
        if kind != own
    }
    tokenizer = bare_tokenizer(vocabulary, [_pair(merge) for merge in merges], pre)
    for text, kind in zip(tokens, kinds, strict=True):
        if kind in (gguf.TokenType.CONTROL, own):
            special = kind == gguf.TokenType.CONTROL
            tokenizer.add_tokens([AddedToken(text, normalized=False, special=special)])
    if any(tokenizer.token_to_id(text) != place for place, text in enumerate(tokens)):
        raise FileError(path, "its tokens are not in the order of gguf_export")
    return tokenizer


def fill_from_gguf(model: Any, path: Path) -> None:
    """Copy a GGUF's weights into a `LlamaForCausalLM`; token embeddings beyond the file's stay.

    Raises:
        FileError: no such file, or no GGUF.
        ModelError: a tensor is missing or of another shape.
    """
    import gguf
    import torch

    config = model.config
    names = gguf.get_tensor_name_map(gguf.MODEL_ARCH.LLAMA, config.num_hidden_layers)
    found = {tensor.name: tensor for tensor in gguf_reader(path).tensors}
    heads = {"attn_q": config.num_attention_heads, "attn_k": config.num_key_value_heads}
    with torch.no_grad():
        for key, value in model.named_parameters():
            name = names.get_name(key, try_suffixes=(".weight",))
            if name not in found:
                raise ModelError(f"{path}: no tensor for {key}")
            array = gguf.quants.dequantize(found[name].data, found[name].tensor_type)
            part = name.split(".")[-2]
            rows = torch.tensor(_half_split(array, heads[part]) if part in heads else array)
            into = value[: len(rows)] if name == "token_embd.weight" else value
            if into.shape != rows.shape:
                raise ModelError(
                    f"{path}: {name} has shape {tuple(rows.shape)}, not {tuple(into.shape)}"
                )
            into.copy_(rows)


def _pair(merge: str) -> tuple[str, str]:
    left, _, right = merge.partition(" ")
    return left, right


def _half_split(array: NDArray[np.float32], heads: int) -> NDArray[np.float32]:
    """Reorder rotary rows from llama.cpp's interleaved pairs to transformers' halves."""
    rows, columns = array.shape
    pairs = array.reshape(heads, rows // heads // 2, 2, columns)
    return np.ascontiguousarray(pairs.swapaxes(1, 2).reshape(rows, columns))


def gguf_reader(path: Path) -> Any:
    """Return a `gguf.GGUFReader`.

    Raises:
        FileError: no such file, or no GGUF.
    """
    import gguf

    if not path.is_file():
        raise FileError(path, "no such file")
    try:
        return gguf.GGUFReader(path)
    except (ValueError, IndexError) as error:
        raise FileError(path, f"not a GGUF: {error}") from error
