"""Say how a GGUF is opened, and open it: after a trial where it may kill nothing but the trial.

Which devices there are, llama.cpp is asked: llama-cpp-python binds none of this, and
`llama_supports_gpu_offload()` is true for a build with a mere RPC backend; so ggml's own functions
are called through ctypes. Source: ggml-backend.h of the pinned llama.cpp.
"""

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from karma.errors import ModelError
from karma.files import rebuild_llama
from karma.models.checks.memory import Footprint
from karma.offline.children import run_child

_MOST = {"n_ctx": 1 << 24, "threads": 512}
_TRIAL_S = 900  # the largest models, from a slow disk
_passed: set[tuple[int, ...]] = set()


@dataclass(frozen=True, slots=True, kw_only=True)
class LlamaOptions:
    """How a GGUF is opened; what is left as it is suits the machine.

    Raises:
        ModelError: a value is out of range.
    """

    gpu_layers: int | Literal["auto"] = "auto"  # all that fit, where there is a GPU
    n_ctx: int | None = None  # tokens; None: grows with the prompts, to what it was trained for
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


def open_gguf(path: Path, keywords: Mapping[str, Any]) -> Any:
    """Return a loaded `Llama`; ModelError names the file where it cannot be loaded."""
    import llama_cpp

    try:
        return llama_cpp.Llama(str(path), verbose=False, **keywords)
    except Exception as error:  # ValueError, RuntimeError, Jinja's: all mean an unusable file
        raise ModelError(f"{path}: llama.cpp cannot load it: {error}") from error


def open_context(llama: Any, tokens: int) -> Any:
    """Open another context over loaded weights, freed with the model at the latest.

    ValueError where there is no memory for it.
    """
    from llama_cpp import _internals, _utils

    parameters = type(llama.context_params).from_buffer_copy(llama.context_params)
    parameters.n_ctx = tokens
    with _utils.suppress_stdout_stderr(disable=False):  # it warns of longer than trained
        return _internals.LlamaContext(model=llama._model, params=parameters, verbose=False)


# ----------------------------------------------------------------- devices


Kind = Literal["cpu", "gpu", "integrated", "accelerator"]
_KINDS: tuple[Kind, ...] = ("cpu", "gpu", "integrated", "accelerator")  # by ggml's number
_SPARE_MB = 256.0  # of a GPU: what its driver takes beside what is asked for


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """One thing that llama.cpp computes on."""

    name: str  # as llama.cpp calls it: "CPU", "CUDA0", "Metal"
    kind: Kind
    description: str

    @property
    def is_gpu(self) -> bool:
        """Whether layers can be put on it."""
        return self.kind in ("gpu", "integrated")


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where a model's layers lie."""

    devices: tuple[str, ...]  # names of GPUs; () on the CPU
    layers: int  # of the model on them, the last one for the output; 0 on the CPU

    @property
    def name(self) -> str:
        """What it is called in records: "CPU", "CUDA0", "CUDA0+CUDA1"."""
        return "+".join(self.devices) or "CPU"

    @property
    def keywords(self) -> Mapping[str, Any]:
        """What llama-cpp-python's `Llama` is given; on the CPU no GPU is touched at all."""
        import llama_cpp

        if self.layers:
            return {"n_gpu_layers": self.layers}
        return {
            "n_gpu_layers": 0, "split_mode": llama_cpp.LLAMA_SPLIT_MODE_NONE, "main_gpu": -1,
            "offload_kqv": False, "op_offload": False,
        }  # fmt: skip


def devices() -> tuple[Device, ...]:
    """Return what the installed llama.cpp can compute on, the CPU among them."""
    ggml = _ggml()
    handles = [ggml.ggml_backend_dev_get(n) for n in range(ggml.ggml_backend_dev_count())]
    return tuple(
        Device(
            name=ggml.ggml_backend_dev_name(handle).decode(),
            kind=_KINDS[min(ggml.ggml_backend_dev_type(handle), len(_KINDS) - 1)],
            description=ggml.ggml_backend_dev_description(handle).decode(errors="replace"),
        )
        for handle in handles
    )


def memory_mb(device: Device) -> tuple[float, float] | None:
    """Return a device's free memory and all of it, in MB; None where it does not tell."""
    ggml = _ggml()
    handle = ggml.ggml_backend_dev_by_name(device.name.encode())
    free, total = ctypes.c_size_t(), ctypes.c_size_t()
    ggml.ggml_backend_dev_memory(handle, ctypes.byref(free), ctypes.byref(total))
    return (free.value / 1e6, total.value / 1e6) if total.value else None


def place(name: str, size: Footprint, options: LlamaOptions, *, context: int) -> Placement:
    """Choose where a model's layers go, and leave room for a context of so many tokens.

    All of them on the GPU where there is one with enough free memory, else as many as fit, else
    none.

    Raises:
        ModelError: layers were asked for by number and there is no GPU, or they do not fit.
    """
    cpu = Placement(devices=(), layers=0)
    if options.gpu_layers == 0:
        return cpu
    found = devices()
    cards = [one for one in found if one.kind == "gpu"]
    used = cards or [one for one in found if one.kind == "integrated"]
    if not used:
        if options.gpu_layers == "auto":
            return cpu
        raise ModelError(
            f"gpu_layers = {options.gpu_layers}, but llama.cpp as it is built here knows no GPU, "
            f"only {', '.join(one.name for one in found)}\n"
            f"  To fix: {rebuild_llama('-DGGML_CUDA=on')} (or -DGGML_METAL=on, -DGGML_VULKAN=on), "
            'or gpu_layers = "auto"'
        )
    names = tuple(gpu.name for gpu in used)
    layers = _fitting(size, context, free_mb(names))
    if options.gpu_layers != "auto":
        wanted = min(options.gpu_layers, size.blocks + 1)
        if wanted > layers:
            raise ModelError(
                f"{name}: gpu_layers = {wanted} do not fit, but {layers} of {size.blocks + 1} do, "
                f"with a context of {context}, on {'+'.join(names)}\n"
                f'  To fix: gpu_layers = {layers}, or "auto", or a smaller n_ctx'
            )
        layers = wanted
    return Placement(devices=names, layers=layers) if layers else cpu


def free_mb(names: Sequence[str]) -> float | None:
    """Return what is free on some GPUs for a model, in MB; None where none of them tells."""
    told = [memory_mb(one) for one in devices() if one.name in names]
    free = [max(0.0, one[0] - _SPARE_MB) for one in told if one is not None]
    return sum(free) if free else None


def _fitting(size: Footprint, context: int, free: float | None) -> int:
    """Return how many layers fit a GPU; all where it does not tell what it has."""
    work_mb = size.work_mb(context, on_gpu=True)
    if free is None or size.layers_mb(context) + work_mb <= free:
        return size.blocks + 1
    return int(max(0.0, free - work_mb) / size.layers_mb(context) * size.blocks)


@cache
def _ggml() -> Any:
    """Return ggml's functions that are used here, with their signatures.

    They are looked up through libllama: a wheel holds each library under three names, and a second
    copy, opened by another name, would have a list of devices of its own.
    """
    from llama_cpp.llama_cpp import _lib

    pointer, text, number = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t
    sizes = ctypes.POINTER(number)
    for name, result, arguments in (
        ("ggml_backend_dev_count", number, []),
        ("ggml_backend_dev_get", pointer, [number]),
        ("ggml_backend_dev_by_name", pointer, [text]),
        ("ggml_backend_dev_name", text, [pointer]),
        ("ggml_backend_dev_description", text, [pointer]),
        ("ggml_backend_dev_type", ctypes.c_int, [pointer]),
        ("ggml_backend_dev_memory", None, [pointer, sizes, sizes]),
    ):
        function = getattr(_lib, name)
        function.restype, function.argtypes = result, arguments
    return _lib
