"""Keep what llama.cpp computed of the stable parts of prompts, so that a room is paid for once.

A state is the keys and values of one stable part, as llama.cpp writes them; put back, it gives the
bits that evaluating would. States live as long as the opened model, up to `MAX_STATES_MB`.
"""

import ctypes
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.models.checks.memory import available_mb

MAX_STATES_MB = 1024  # of one opened model; the least recently used state goes first
State = NDArray[np.uint8]  # as llama.cpp writes it


class RoomStates:
    """The states of one opened model, by the tokens of the stable part."""

    def __init__(self) -> None:
        self._states: OrderedDict[tuple[int, ...], State] = OrderedDict()

    def find(self, tokens: Sequence[int]) -> State | None:
        """Return a stable part's state, or None if it has to be evaluated."""
        state = self._states.get(tuple(tokens))
        if state is not None:
            self._states.move_to_end(tuple(tokens))
        return state

    def keep(self, tokens: Sequence[int], state: State) -> None:
        """Keep a state, not to be changed afterwards, if there is memory for it."""
        room = MAX_STATES_MB * 1e6 - state.nbytes
        held = sum(kept.nbytes for kept in self._states.values())
        while self._states and held > max(room, 0):
            held -= self._states.popitem(last=False)[1].nbytes
        free = available_mb()
        if room >= 0 and (free is None or state.nbytes < free * 1e6 / 2):
            self._states[tuple(tokens)] = state

    def forget(self, tokens: Sequence[int]) -> None:
        """Drop a state that llama.cpp would not take."""
        self._states.pop(tuple(tokens), None)


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
