"""Load a GGUF under llama.cpp, after a trial where it may kill nothing but the trial."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from karma.errors import ModelError
from karma.offline.children import run_child

_TRIAL_S = 900  # the largest models, from a slow disk
_passed: set[tuple[int, ...]] = set()


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
