"""Export a Llama in PyTorch and a byte-level BPE tokenizer as one GGUF file.

Plain Llama only: no rope scaling, no biases, no experts.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError
from karma.infer.llama.gguf_files import (
    LLAMA_BPE_REGEX,
    add_special_tokens,
    add_vocabulary,
    interleave,
    write_gguf,
)

DType = Literal["F32", "F16", "BF16", "Q8_0"]


def export_llama_gguf(
    weights: Any,
    tokenizer: Any,
    path: str | Path,
    *,
    name: str,
    eos_token: str,
    bos_token: str | None = None,
    pad_token: str | None = None,
    add_bos: bool = False,
    config: Any = None,
    dtype: DType = "F16",
    chat_template: str | None = None,
    licence: str | None = None,
    description: str | None = None,
) -> None:
    """Write a GGUF that llama.cpp runs with the same tokens and, in F32, the same logits.

    Args:
        weights: a `transformers.LlamaForCausalLM`, or its state dict (then give `config`).
        tokenizer: a `tokenizers.Tokenizer` with the pre-tokenizer of `new_tokenizer`.
        path: the file; appears whole or not at all.
        name: general.name.
        eos_token: text of the token that ends an answer; the other tokens may be absent.
        bos_token: first token of a text, put there by llama.cpp when `add_bos`.
        pad_token: padding, never produced.
        add_bos: whether llama.cpp begins every text with `bos_token`.
        config: the `LlamaConfig`, by default the model's own.
        dtype: of the matrices; norms stay F32. "Q8_0" needs row sizes divisible by 32.
        chat_template: Jinja text.
        licence: SPDX name.
        description: one line.

    Raises:
        ModelError: the model or tokenizer has a part that this format would lose.
        FileError: it cannot be written; nothing half-written stays.
    """
    config = weights.config if config is None else config
    state: Mapping[str, Any] = weights.state_dict() if hasattr(weights, "state_dict") else weights
    _check_config(config)
    _check_tokenizer(tokenizer, config.vocab_size)
    specials = {"bos": bos_token, "eos": eos_token, "pad": pad_token}

    def fill(writer: Any) -> None:
        writer.add_name(name)
        if licence is not None:
            writer.add_license(licence)
        if description is not None:
            writer.add_description(description)
        _add_shape(writer, config, dtype)
        add_vocabulary(writer, tokenizer, config.vocab_size)
        add_special_tokens(writer, tokenizer, specials, add_bos=add_bos)
        if chat_template is not None:
            writer.add_chat_template(chat_template)
        for tensor, array in _tensors(state, config):
            _add_tensor(writer, tensor, array, dtype)

    write_gguf(Path(path), fill)


def _check_config(config: Any) -> None:
    """Refuse what a plain Llama does not have."""
    rope = getattr(config, "rope_parameters", None) or getattr(config, "rope_scaling", None) or {}
    if rope.get("rope_type", "default") != "default":
        raise ModelError(f"rope type {rope['rope_type']!r} cannot be exported, only 'default'")
    if getattr(config, "attention_bias", False) or getattr(config, "mlp_bias", False):
        raise ModelError("a Llama with biases cannot be exported")
    if config.hidden_act != "silu":
        raise ModelError(f"activation {config.hidden_act!r} cannot be exported, only 'silu'")


def _check_tokenizer(tokenizer: Any, vocab_size: int) -> None:
    """Refuse a tokenizer that llama.cpp would silently replace by another one."""
    content = json.loads(tokenizer.to_str())
    if content["model"]["type"] != "BPE" or content["normalizer"] is not None:
        raise ModelError("only a byte-level BPE tokenizer without normalizer can be exported")
    if json.dumps(LLAMA_BPE_REGEX) not in tokenizer.to_str():
        raise ModelError("the pre-tokenizer is not llama-bpe; train it with new_tokenizer()")
    if tokenizer.get_vocab_size() > vocab_size:
        size = tokenizer.get_vocab_size()
        raise ModelError(f"the tokenizer has {size} tokens, the model only {vocab_size}")


def _head_dim(config: Any) -> int:
    return int(
        getattr(config, "head_dim", None) or config.hidden_size // config.num_attention_heads
    )


def _add_shape(writer: Any, config: Any, dtype: DType) -> None:
    import gguf

    rope = getattr(config, "rope_parameters", None) or {}
    theta: Any = rope.get("rope_theta") or getattr(config, "rope_theta", 10000.0)
    writer.add_context_length(config.max_position_embeddings)
    writer.add_embedding_length(config.hidden_size)
    writer.add_block_count(config.num_hidden_layers)
    writer.add_feed_forward_length(config.intermediate_size)
    writer.add_vocab_size(config.vocab_size)
    writer.add_head_count(config.num_attention_heads)
    writer.add_head_count_kv(config.num_key_value_heads)
    writer.add_key_length(_head_dim(config))
    writer.add_value_length(_head_dim(config))
    writer.add_layer_norm_rms_eps(config.rms_norm_eps)
    writer.add_rope_freq_base(theta)
    writer.add_rope_dimension_count(_head_dim(config))
    kind = "ALL_F32" if dtype == "F32" else f"MOSTLY_{dtype}"
    writer.add_file_type(gguf.LlamaFileType[kind])
    writer.add_quantization_version(gguf.GGML_QUANT_VERSION)


def _tensors(state: Mapping[str, Any], config: Any) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield GGUF names and float32 arrays, in the order of the state dict."""
    import gguf

    names = gguf.get_tensor_name_map(gguf.MODEL_ARCH.LLAMA, config.num_hidden_layers)
    heads = {"attn_q": config.num_attention_heads, "attn_k": config.num_key_value_heads}
    for key, tensor in state.items():
        name = names.get_name(key, try_suffixes=(".weight",))
        if name is None or not name.endswith(".weight"):
            raise ModelError(f"tensor {key!r} has no place in a Llama GGUF")
        if name == "output.weight" and config.tie_word_embeddings:
            continue
        array = np.ascontiguousarray(tensor.detach().cpu().float().numpy())
        part = name.split(".")[-2]
        yield name, interleave(array, heads[part]) if part in heads else array


def _add_tensor(writer: Any, name: str, array: NDArray[np.float32], dtype: DType) -> None:
    import gguf

    if array.ndim == 1 or dtype == "F32":
        writer.add_tensor(name, array)
    elif dtype == "F16":
        writer.add_tensor(name, array.astype(np.float16))
    else:
        kind = gguf.GGMLQuantizationType[dtype]
        try:
            data = gguf.quants.quantize(array, kind)
        except gguf.quants.QuantError as error:
            raise ModelError(f"tensor {name!r} cannot be stored as {dtype}: {error}") from error
        writer.add_tensor(name, data, raw_dtype=kind)
