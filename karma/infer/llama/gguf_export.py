"""Export a Llama in PyTorch and a byte-level BPE tokenizer as one GGUF file.

llama.cpp loads a file with a wrong tokenizer name or unpermuted attention rows without a word and
then computes something else, so everything here is checked by comparing tokens and logits
(`tests/infer/test_gguf_export.py`). Plain Llama only: no rope scaling, no biases, no experts.
"""

import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from karma.errors import FileError, ModelError
from karma.files import write_atomic

DType = Literal["F32", "F16", "BF16", "Q8_0"]

# The expression llama.cpp uses for tokenizer.ggml.pre = "llama-bpe"; letter case is spelled out
# because "(?i:...)" would also admit letters that fold to these.
LLAMA_BPE_REGEX = (
    r"(?:'[sS]|'[tT]|'[rR][eE]|'[vV][eE]|'[mM]|'[lL][lL]|'[dD])"
    r"|[^\r\n\p{L}\p{N}]?\p{L}+|\p{N}{1,3}| ?[^\s\p{L}\p{N}]+[\r\n]*|\s*[\r\n]+|\s+(?!\S)|\s+"
)

SPLITS = {
    "llama-bpe": LLAMA_BPE_REGEX,
    "qwen2": LLAMA_BPE_REGEX.replace("{1,3}", ""),  # each digit for itself
    "smollm": "",  # digits for themselves, then as GPT-2 does
}


def new_tokenizer(corpus: Iterable[str], vocab_size: int, special_tokens: Sequence[str]) -> Any:
    """Train a byte-level BPE `tokenizers.Tokenizer` that llama.cpp reproduces token for token.

    Args:
        corpus: texts to learn merges from.
        vocab_size: upper bound of the vocabulary, special tokens included; at least 256 of them
            are single bytes, so every text can be encoded.
        special_tokens: control tokens, given the first ids in this order.
    """
    from tokenizers import pre_tokenizers, trainers

    tokenizer = bare_tokenizer()
    trainer = trainers.BpeTrainer(
        vocab_size=vocab_size,
        special_tokens=list(special_tokens),
        initial_alphabet=sorted(pre_tokenizers.ByteLevel.alphabet()),
        show_progress=False,
    )
    tokenizer.train_from_iterator(corpus, trainer)
    tokenizer.model.ignore_merges = True  # as llama.cpp does for "llama-bpe"
    return tokenizer


def bare_tokenizer(
    vocabulary: Mapping[str, int] | None = None,
    merges: Sequence[tuple[str, str]] = (),
    pre: str = "llama-bpe",
) -> Any:
    """Return a `tokenizers.Tokenizer` of these pieces that splits and joins as llama.cpp does.

    Raises:
        ModelError: `pre`, llama.cpp's name for how a text is split, is none of `SPLITS`.
    """
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers

    if pre not in SPLITS:
        raise ModelError(f"texts are split in the way {pre!r}; known are: {', '.join(SPLITS)}")
    pieces = None if vocabulary is None else dict(vocabulary)
    tokenizer = Tokenizer(
        models.BPE(
            vocab=pieces,
            merges=None if pieces is None else list(merges),
            ignore_merges=pre == "llama-bpe",
        )
    )
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(_splitters(pre))
    tokenizer.decoder = decoders.ByteLevel()
    return tokenizer


def _splitters(pre: str) -> list[Any]:
    from tokenizers import Regex, pre_tokenizers

    if pre == "smollm":
        digits = pre_tokenizers.Digits(individual_digits=True)
        return [digits, pre_tokenizers.ByteLevel(add_prefix_space=False)]
    return [
        pre_tokenizers.Split(Regex(SPLITS[pre]), behavior="isolated"),
        pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False),
    ]


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


def add_vocabulary(writer: Any, tokenizer: Any, vocab_size: int, *, pre: str = "llama-bpe") -> None:
    """Write tokens in id order, their types, and the merges in rank order.

    Args:
        writer: a `gguf.GGUFWriter`.
        tokenizer: a `tokenizers.Tokenizer` of `new_tokenizer`.
        vocab_size: of the model; ids that the tokenizer lacks are never said.
        pre: how llama.cpp splits a text; only with the default are its tokens the tokenizer's.
    """
    import gguf

    tokens = [f"[unused{i}]" for i in range(vocab_size)]
    types = [int(gguf.TokenType.UNUSED)] * vocab_size
    for text, token in tokenizer.get_vocab(with_added_tokens=False).items():
        tokens[token], types[token] = text, int(gguf.TokenType.NORMAL)
    for token, added in tokenizer.get_added_tokens_decoder().items():
        kind = gguf.TokenType.CONTROL if added.special else gguf.TokenType.USER_DEFINED
        tokens[token], types[token] = added.content, int(kind)
    merges = json.loads(tokenizer.to_str())["model"]["merges"]
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre(pre)
    writer.add_token_list(tokens)
    writer.add_token_types(types)
    writer.add_token_merges([m if isinstance(m, str) else " ".join(m) for m in merges])


def add_special_tokens(
    writer: Any, tokenizer: Any, specials: Mapping[str, str | None], *, add_bos: bool
) -> None:
    """Write the ids of the tokens "bos", "eos" and "pad", where there are such.

    Raises:
        ModelError: one is not in the vocabulary, or `add_bos` without a "bos".
    """
    add = {
        "bos": writer.add_bos_token_id,
        "eos": writer.add_eos_token_id,
        "pad": writer.add_pad_token_id,
    }
    for use, text in specials.items():
        if text is None:
            continue
        token = tokenizer.token_to_id(text)
        if token is None:
            raise ModelError(f"the {use} token {text!r} is not in the tokenizer's vocabulary")
        add[use](token)
    if add_bos and specials["bos"] is None:
        raise ModelError("add_bos needs a bos_token")
    writer.add_add_bos_token(add_bos)
    writer.add_add_eos_token(False)


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


def interleave(array: NDArray[np.float32], heads: int) -> NDArray[np.float32]:
    """Reorder rotary rows from transformers' half-split to llama.cpp's interleaved pairs."""
    rows, columns = array.shape
    halves = array.reshape(heads, 2, rows // heads // 2, columns)
    return np.ascontiguousarray(halves.swapaxes(1, 2).reshape(rows, columns))


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


def write_gguf(path: Path, fill: Any, architecture: str = "llama") -> None:
    """Let `fill` build the file elsewhere, then put it in its place."""
    import gguf

    try:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / "made.gguf"
            writer = gguf.GGUFWriter(made, architecture)
            fill(writer)
            writer.write_header_to_file()
            writer.write_kv_data_to_file()
            writer.write_tensors_to_file()
            writer.close()
            write_atomic(path, made.read_bytes())
    except OSError as error:
        fix = "free some space there, or set TMPDIR to another folder"
        raise FileError(path, f"cannot write: {error.strerror or error}", fix=fix) from error
