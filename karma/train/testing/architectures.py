"""Name the keys and tensors that llama.cpp wants of a language model, per architecture."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from karma.train.testing.random_gguf import Shape


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """The shape of a language model; the width of a head is `width / heads`."""

    layers: int = 2
    width: int = 32
    heads: int = 2
    kv_heads: int = 1
    feed_forward: int = 48
    vocabulary: int = 1280
    context: int = 8192
    tied: bool = False  # the embedding is the output too

    @property
    def head(self) -> int:
        """Numbers per head of attention."""
        return self.width // self.heads


_BIASED = ("qwen2", "qwen2vl")  # queries, keys and values have biases
_HEAD_NORMS = ("qwen3", "gemma3")  # queries and keys are normed
_MORE_KEYS: Mapping[str, Mapping[str, Any]] = {
    # a window shorter than any prompt, every second layer global: both kinds of layer are met
    "gemma3": {"attention.sliding_window": 64, "attention.sliding_window_pattern": 2},
    "qwen2vl": {"rope.dimension_sections": [2, 3, 3, 0]},  # half a head of 16: time, height, width
}


def language_keys(architecture: str, size: Size) -> Iterator[tuple[str, Any]]:
    """Yield the metadata of a language model, tokenizer and name apart."""
    keys: dict[str, Any] = {
        "context_length": size.context,
        "embedding_length": size.width,
        "block_count": size.layers,
        "feed_forward_length": size.feed_forward,
        "vocab_size": size.vocabulary,
        "attention.head_count": size.heads,
        "attention.head_count_kv": size.kv_heads,
        "attention.key_length": size.head,
        "attention.value_length": size.head,
        "attention.layer_norm_rms_epsilon": 1e-5,
        "rope.freq_base": 10000.0,
        "rope.dimension_count": size.head,
        **_MORE_KEYS.get(architecture, {}),
    }
    yield from ((f"{architecture}.{key}", value) for key, value in keys.items())


def language_tensors(architecture: str, size: Size) -> Iterator[tuple[str, Shape]]:
    """Yield (name, shape) of a language model."""
    yield "token_embd.weight", (size.vocabulary, size.width)
    if not size.tied:
        yield "output.weight", (size.vocabulary, size.width)
    yield "output_norm.weight", (size.width,)
    for layer in range(size.layers):
        for name, shape in _block(architecture, size):
            yield f"blk.{layer}.{name}", shape


def _block(architecture: str, size: Size) -> Iterator[tuple[str, Shape]]:
    width, inner = size.width, size.feed_forward
    rows = {
        "q": size.heads * size.head,
        "k": size.kv_heads * size.head,
        "v": size.kv_heads * size.head,
    }
    yield "attn_norm.weight", (width,)
    if architecture == "phi3":  # one matrix for all three, one for gate and up
        yield "attn_qkv.weight", (sum(rows.values()), width)
        yield "ffn_up.weight", (2 * inner, width)
    else:
        for part, count in rows.items():
            yield f"attn_{part}.weight", (count, width)
            if architecture in _BIASED:
                yield f"attn_{part}.bias", (count,)
        yield "ffn_gate.weight", (inner, width)
        yield "ffn_up.weight", (inner, width)
    if architecture in _HEAD_NORMS:
        yield "attn_q_norm.weight", (size.head,)
        yield "attn_k_norm.weight", (size.head,)
    if architecture == "gemma3":
        yield "post_attention_norm.weight", (width,)
        yield "post_ffw_norm.weight", (width,)
    yield "attn_output.weight", (width, rows["q"])
    yield "ffn_norm.weight", (width,)
    yield "ffn_down.weight", (width, inner)
