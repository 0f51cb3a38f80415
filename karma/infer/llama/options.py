"""Say how a GGUF is opened: on which device, with how much context, by which kernels."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from karma.errors import ModelError

KvType = Literal["f16", "f32", "q8_0"]
Switch = Literal["auto", "on", "off"]

KV_BYTES = {"f16": 2.0, "f32": 4.0, "q8_0": 34 / 32}  # of a number: q8_0 has a scale per 32
_MOST = {"n_ctx": 1 << 24, "threads": 512}
_BLOCK = 32  # numbers of q8_0 that share a scale


@dataclass(frozen=True, slots=True, kw_only=True)
class LlamaOptions:
    """How a GGUF is opened; what is left as it is suits the machine.

    Raises:
        ModelError: a value is out of range, or two do not go together.
    """

    gpu_layers: int | Literal["auto"] = "auto"  # all that fit, where there is a GPU
    n_ctx: int | None = None  # tokens; None: grows with the prompts, to what it was trained for
    beyond_training: bool = False  # n_ctx may be more; what answers are then worth is open
    flash_attention: Switch = "auto"  # on a GPU, and where `kv` needs it
    kv: KvType = "f16"  # of the kept keys and values
    threads: int = 1  # more than the cores that are free wait for each other

    def __post_init__(self) -> None:
        """Refuse what llama.cpp would take without a word, or end the process over."""
        if self.gpu_layers != "auto" and not (
            isinstance(self.gpu_layers, int) and self.gpu_layers >= 0
        ):
            raise ModelError(f'gpu_layers = {self.gpu_layers!r}: a number from 0 on, or "auto"')
        for name in ("n_ctx", "threads"):
            value = getattr(self, name)
            if value is not None and not 1 <= value <= _MOST[name]:  # beyond, it ends the process
                raise ModelError(f"{name} = {value}: 1 to {_MOST[name]}")
        for name, value, known in (
            ("flash_attention", self.flash_attention, get_args(Switch)),
            ("kv", self.kv, get_args(KvType)),
        ):
            if value not in known:
                raise ModelError(f"{name} = {value!r}: one of {', '.join(known)}")
        if self.beyond_training and self.n_ctx is None:
            raise ModelError("beyond_training = true needs n_ctx, the tokens of the context")
        if self.kv == "q8_0" and self.flash_attention == "off":
            raise ModelError(
                "kv = 'q8_0' needs flash attention, and flash_attention = 'off'\n"
                "  To fix: take either away, or kv = 'f16'"
            )

    def flash(self, *, on_gpu: bool) -> bool:
        """Return whether flash attention is used."""
        wanted = on_gpu or self.kv == "q8_0"
        return wanted if self.flash_attention == "auto" else self.flash_attention == "on"


def check_width(name: str, metadata: Mapping[str, Any], options: LlamaOptions) -> None:
    """Refuse q8_0 keys and values where a head's width is no multiple of a block; name it."""
    kind = metadata["general.architecture"]
    heads = int(metadata[f"{kind}.attention.head_count"])
    each = int(metadata[f"{kind}.embedding_length"]) // heads
    width = metadata.get(f"{kind}.attention.key_length", each)
    if options.kv == "q8_0" and width % _BLOCK:
        raise ModelError(
            f"{name}: kv = 'q8_0' needs heads of a multiple of {_BLOCK} numbers, its have {width}\n"
            "  To fix: kv = 'f16'"
        )
