"""Take keys and values out of a llama.cpp context, and put them back."""

import ctypes
import platform
from typing import Any

import numpy as np
from numpy.typing import NDArray

State = NDArray[np.uint8]  # as llama.cpp writes it


def llama_build() -> str:
    """Return version and build of llama.cpp: what else could change bits than a model and options.

    The features of the processor that it was compiled for are in it.
    """
    import llama_cpp

    said = llama_cpp.llama_version() + b" " + llama_cpp.llama_print_system_info()
    return f"{llama_cpp.__version__} {platform.machine()} {said.decode(errors='replace')}"


def taken_out(context: Any) -> State:
    """Return the state of what a context holds, of its first sequence."""
    import llama_cpp

    size = llama_cpp.llama_state_seq_get_size(context, 0)
    state = np.empty(size, np.uint8)
    written = llama_cpp.llama_state_seq_get_data(context, _bytes_of(state), size, 0)
    return state[:written]


def put_back(context: Any, state: State) -> bool:
    """Put a state into a context, in place of what it holds; False: refused, nothing is in it."""
    import llama_cpp

    memory = llama_cpp.llama_get_memory(context)
    llama_cpp.llama_memory_seq_rm(memory, 0, -1, -1)
    size = state.nbytes
    taken = bool(size) and llama_cpp.llama_state_seq_set_data(context, _bytes_of(state), size, 0)
    if taken != size:
        llama_cpp.llama_memory_seq_rm(memory, 0, -1, -1)
    return taken == size


def _bytes_of(state: State) -> Any:
    return state.ctypes.data_as(ctypes.POINTER(ctypes.c_uint8))
