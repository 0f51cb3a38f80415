"""Say how a GGUF is opened, and open it: after a trial where it may kill nothing but the trial."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from karma.errors import ModelError
from karma.offline.children import run_child

KvType = Literal["f16", "f32", "q8_0"]
Switch = Literal["auto", "on", "off"]

KV_BYTES = {"f16": 2.0, "f32": 4.0, "q8_0": 34 / 32}  # of a number: q8_0 has a scale per 32
_MOST = {"n_ctx": 1 << 24, "threads": 512}
_BLOCK = 32  # numbers of q8_0 that share a scale
_TRIAL_S = 900  # the largest models, from a slow disk
_passed: set[tuple[int, ...]] = set()


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


def try_in_own_process(trial: str, *files: Path, cannot: str) -> None:
    """Try files that nobody vouches for where they may kill nothing but the trial.

    llama.cpp aborts on some damaged files whose header looks right. What has passed is not tried
    again by this process, as long as nobody has written to it. `trial` is "module:function", which
    gets the paths; errors say of the last file what llama.cpp `cannot`.

    Raises:
        ModelError: the trial failed.
    """
    found = [path.stat() for path in files]
    tried = tuple(
        number
        for one in found
        for number in (one.st_dev, one.st_ino, one.st_size, one.st_mtime_ns, one.st_ctime_ns)
    )
    if tried in _passed:
        return
    end = run_child(trial, *map(str, files), limit_s=_TRIAL_S)
    if end.code is None:
        raise ModelError(f"{files[-1]}: llama.cpp had not opened it after {_TRIAL_S} s")
    if end.code:
        raise ModelError(f"{files[-1]}: llama.cpp {cannot} (code {end.code}): {end.said}")
    _passed.add(tried)


def open_gguf(path: Path, keywords: Mapping[str, Any], *, kv: str) -> tuple[Any, int]:
    """Return a loaded `Llama`, and how many layers llama.cpp says that it has put on GPUs.

    ModelError names the file where it cannot be loaded.
    """
    import llama_cpp

    kinds = {
        "f16": llama_cpp.GGML_TYPE_F16, "f32": llama_cpp.GGML_TYPE_F32,
        "q8_0": llama_cpp.GGML_TYPE_Q8_0,
    }  # fmt: skip
    with _listening() as said:
        try:
            llama = llama_cpp.Llama(
                str(path), type_k=kinds[kv], type_v=kinds[kv], verbose=False, **keywords
            )
        except Exception as error:  # ValueError, RuntimeError, Jinja's: all mean an unusable file
            raise ModelError(f"{path}: llama.cpp cannot load it: {error}") from error
    layers = re.findall(rb"offloaded (\d+)/\d+ layers to GPU", b"".join(said))
    return llama, int(layers[-1]) if layers else 0


@contextmanager
def _listening() -> Iterator[list[bytes]]:
    """Collect what llama.cpp logs meanwhile: it tells nowhere else what it has done."""
    import llama_cpp
    from llama_cpp import _logger

    said: list[bytes] = []

    def listen(level: int, text: bytes, _: Any) -> None:
        said.append(text)

    callback: Any = llama_cpp.llama_log_callback(listen)
    llama_cpp.llama_log_set(callback, None)
    try:
        yield said
    finally:
        llama_cpp.llama_log_set(_logger.llama_log_callback, None)


def open_context(llama: Any, tokens: int, *, sequences: int = 1, batch: int = 0) -> Any:
    """Open one more context over loaded weights, freed with the model at the latest.

    Its cache holds so many tokens of all sequences together; a batch of 0 is the model's own.
    ValueError where there is no memory for it.
    """
    from llama_cpp import _internals, _utils

    parameters = type(llama.context_params).from_buffer_copy(llama.context_params)
    parameters.n_ctx = tokens
    if sequences > 1:
        parameters.n_seq_max, parameters.kv_unified = sequences, True
    if batch:
        parameters.n_batch = parameters.n_ubatch = batch
    with _utils.suppress_stdout_stderr(disable=False):  # it warns of longer than trained
        return _internals.LlamaContext(model=llama._model, params=parameters, verbose=False)
