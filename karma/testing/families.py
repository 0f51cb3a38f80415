"""List the model families that are made here: architecture, control tokens, chat template."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from karma.errors import UnknownNameError

Shape = tuple[int, ...]
_TEMPLATES = Path(__file__).parent / "templates"
_CHATML = ("<|endoftext|>", "<|im_start|>", "<|im_end|>")
_THOUGHT = ("<think>", "</think>")
_LLAMA3 = (
    "<|begin_of_text|>", "<|end_of_text|>", "<|start_header_id|>", "<|end_header_id|>",
    "<|eot_id|>",
)  # fmt: skip
_IDEFICS = ("<fake_token_around_image>", "<global-img>", "<image>", "<end_of_utterance>")
_SEEN = ("<|vision_start|>", "<|vision_end|>", "<|image_pad|>")


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One model family, as its GGUF files are: what is not random about them."""

    name: str
    architecture: str  # general.architecture of the language part
    control: tuple[str, ...]  # control tokens
    eos: str
    bos: str | None = None
    add_bos: bool = False  # whether llama.cpp begins every text with it
    pre: str = "llama-bpe"  # tokenizer.ggml.pre; ours where the family's tokenizer is no BPE
    added: tuple[str, ...] = ()  # tokens of their own that are text, not control
    projector: str | None = None  # clip.projector_type of the picture part

    @property
    def template(self) -> str:
        """The chat template, Jinja: ours, in the family's format."""
        return (_TEMPLATES / f"{self.name}.j2").read_text(encoding="utf-8")


_LISTED = (
    Family(name="llama3", architecture="llama", control=_LLAMA3, bos="<|begin_of_text|>",
           eos="<|eot_id|>", add_bos=True),
    Family(name="qwen2.5", architecture="qwen2", control=_CHATML, eos="<|im_end|>", pre="qwen2"),
    Family(name="qwen3", architecture="qwen3", control=_CHATML, eos="<|im_end|>", pre="qwen2",
           added=_THOUGHT),
    Family(name="qwq", architecture="qwen2", control=_CHATML, eos="<|im_end|>", pre="qwen2",
           added=_THOUGHT),
    Family(name="gemma3", architecture="gemma3", bos="<bos>", eos="<end_of_turn>", add_bos=True,
           control=("<pad>", "<eos>", "<bos>", "<start_of_turn>", "<end_of_turn>")),
    Family(name="mistral", architecture="llama", bos="<s>", eos="</s>", add_bos=True, pre="tekken",
           control=("<unk>", "<s>", "</s>", "[INST]", "[/INST]")),
    Family(name="phi3", architecture="phi3", bos="<s>", eos="<|end|>", add_bos=True,
           control=("<unk>", "<s>", "</s>", "<|endoftext|>", "<|system|>", "<|user|>",
                    "<|assistant|>", "<|end|>")),
    Family(name="smollm", architecture="llama", control=_CHATML, bos="<|im_start|>",
           eos="<|im_end|>", pre="smollm"),
    Family(name="lfm2", architecture="lfm2", control=_CHATML, eos="<|im_end|>", pre="qwen2"),
    Family(name="mamba", architecture="mamba", control=_CHATML, eos="<|im_end|>", pre="qwen2"),
    Family(name="qwen2.5-vl", architecture="qwen2vl", control=(*_CHATML, *_SEEN), eos="<|im_end|>",
           pre="qwen2", projector="qwen2.5vl_merger"),
    Family(name="smolvlm", architecture="llama", control=(*_CHATML, *_IDEFICS), bos="<|im_start|>",
           eos="<end_of_utterance>", pre="smollm", projector="idefics3"),
    Family(name="idefics3", architecture="llama", control=(*_LLAMA3, *_IDEFICS),
           bos="<|begin_of_text|>", eos="<end_of_utterance>", add_bos=True,
           projector="idefics3"),
    Family(name="llava", architecture="llama", control=("<unk>", "<s>", "</s>", "<image>"),
           bos="<s>", eos="</s>", add_bos=True, projector="mlp"),
)  # fmt: skip
FAMILIES: Mapping[str, Family] = MappingProxyType({family.name: family for family in _LISTED})
PICTURE_FAMILIES = tuple(family.name for family in _LISTED if family.projector is not None)


def find_family(name: str) -> Family:
    """Return the family of that name; UnknownNameError if there is none."""
    if name not in FAMILIES:
        raise UnknownNameError(f"no model family {name!r}; there are {', '.join(FAMILIES)}")
    return FAMILIES[name]


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
_HEAD_NORMS = ("qwen3", "gemma3", "lfm2")  # queries and keys are normed
_MORE_KEYS: Mapping[str, Mapping[str, Any]] = {
    # a window shorter than any prompt, every second layer global: both kinds of layer are met
    "gemma3": {"attention.sliding_window": 64, "attention.sliding_window_pattern": 2},
    "qwen2vl": {"rope.dimension_sections": [2, 3, 3, 0]},  # half a head of 16: time, height, width
}


_CONVOLUTION, _STATE, _RANK = 4, 16, 2  # of Mamba: kernel, numbers of a state, of a time step


def _is_attention(layer: int) -> bool:
    """Return whether a layer of LFM2 made here attends; the others are short convolutions."""
    return layer % 2 == 1


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
    if architecture == "lfm2":
        heads = [size.kv_heads * _is_attention(layer) for layer in range(size.layers)]
        keys |= {"attention.head_count_kv": heads, "shortconv.l_cache": _CONVOLUTION - 1}
    if architecture == "mamba":
        keys |= {
            "feed_forward_length": 0, "attention.head_count": 0,
            "ssm.conv_kernel": _CONVOLUTION, "ssm.state_size": _STATE,
            "ssm.inner_size": 2 * size.width, "ssm.time_step_rank": _RANK,
        }  # fmt: skip
    yield from ((f"{architecture}.{key}", value) for key, value in keys.items())


def language_tensors(architecture: str, size: Size) -> Iterator[tuple[str, Shape]]:
    """Yield (name, shape) of a language model."""
    yield "token_embd.weight", (size.vocabulary, size.width)
    if not size.tied and architecture != "lfm2":
        yield "output.weight", (size.vocabulary, size.width)
    norm = "token_embd_norm" if architecture == "lfm2" else "output_norm"
    yield f"{norm}.weight", (size.width,)
    for layer in range(size.layers):
        block = _block(architecture, size)
        if architecture == "mamba":
            block = _mamba_block(size)
        elif architecture == "lfm2" and not _is_attention(layer):
            block = _convolution_block(size)
        for name, shape in block:
            yield f"blk.{layer}.{name}", shape


def _mamba_block(size: Size) -> Iterator[tuple[str, Shape]]:
    width, inner = size.width, 2 * size.width
    yield "attn_norm.weight", (width,)
    yield "ssm_in.weight", (2 * inner, width)
    yield "ssm_conv1d.weight", (inner, _CONVOLUTION)
    yield "ssm_conv1d.bias", (inner,)
    yield "ssm_x.weight", (_RANK + 2 * _STATE, inner)
    yield "ssm_dt.weight", (inner, _RANK)
    yield "ssm_dt.bias", (inner,)
    yield "ssm_a", (inner, _STATE)
    yield "ssm_d", (inner,)
    yield "ssm_out.weight", (width, inner)


def _convolution_block(size: Size) -> Iterator[tuple[str, Shape]]:
    width, inner = size.width, size.feed_forward
    yield "attn_norm.weight", (width,)
    yield "shortconv.conv.weight", (width, _CONVOLUTION - 1)
    yield "shortconv.in_proj.weight", (3 * width, width)
    yield "shortconv.out_proj.weight", (width, width)
    yield "ffn_norm.weight", (width,)
    yield "ffn_gate.weight", (inner, width)
    yield "ffn_up.weight", (inner, width)
    yield "ffn_down.weight", (width, inner)


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
