"""List the model families that are made here: architecture, control tokens, chat template."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from karma.errors import UnknownNameError

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
    """Return the family of that name.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in FAMILIES:
        raise UnknownNameError(f"no model family {name!r}; there are {', '.join(FAMILIES)}")
    return FAMILIES[name]
