"""Keep what llama.cpp computed of the stable parts of prompts, so that a room is paid for once.

A state is the keys and values of one stable part, as llama.cpp writes them; put back, it gives the
bits that evaluating would. Its name is the hash of all that these bits depend on: the model's
SHA-256, the tokens, the version and build of llama.cpp, and the options that choose its kernels.

States lie in memory and, where a folder is given, on disk, for later runs and other processes. Both
are bounded, and what was used longest ago goes. A file is written whole or not at all, and its name
holds the hash of its content: one that is torn or changed is thrown away. The hash guards against
damage, not against people: whoever may write into the folder decides what the model reads.
"""

import ctypes
import hashlib
import logging
import platform
import time
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.contracts import KvState
from karma.errors import UnwritableError
from karma.files import write_atomic
from karma.models.checks.memory import available_mb

_SUFFIX = ".kvstate"
_LEFT_S = 3600.0  # after which a half-written file has been left by a process that died
_log = logging.getLogger(__name__)
State = NDArray[np.uint8]  # as llama.cpp writes it


@dataclass(frozen=True, slots=True, kw_only=True)
class StateOptions:
    """Where states are kept, and how much of them; nothing is kept in 0 MB."""

    folder: Path | None = None  # None: in memory only
    folder_mb: int = 8192  # in the folder, of all models and processes together
    memory_mb: int = 1024  # in this process, beside the room that was used last

    @property
    def any(self) -> bool:
        """Whether anything is kept at all."""
        return self.memory_mb > 0 or self.folder is not None


class RoomStates:
    """The states of one opened model.

    `identity`: everything but the tokens that a state's bits depend on.
    """

    def __init__(self, identity: str, options: StateOptions) -> None:
        self.options = options
        self._identity = hashlib.sha256(identity.encode()).digest()
        self._memory: OrderedDict[str, State] = OrderedDict()  # used longest ago first
        self._folder = None if options.folder is None else _Folder(options.folder, options)

    def find(self, tokens: Sequence[int]) -> tuple[State, KvState] | None:
        """Return a stable part's state, and where it was; None if it has to be evaluated."""
        name = self._name(tokens)
        if name in self._memory:
            self._memory.move_to_end(name)
            return self._memory[name], "kept"
        state = None if self._folder is None else self._folder.load(name)
        if state is None:
            return None
        self._remember(name, state)
        return state, "loaded"

    def keep(self, tokens: Sequence[int], state: State) -> None:
        """Keep a state, not to be changed afterwards; that there is no room is no error."""
        name = self._name(tokens)
        self._remember(name, state)
        if self._folder is not None:
            self._folder.save(name, state)

    def forget(self, tokens: Sequence[int]) -> None:
        """Drop a state that llama.cpp would not take."""
        name = self._name(tokens)
        self._memory.pop(name, None)
        if self._folder is not None:
            self._folder.drop(name)

    def _name(self, tokens: Sequence[int]) -> str:
        return hashlib.sha256(self._identity + np.asarray(tokens, "<i4").tobytes()).hexdigest()

    def _remember(self, name: str, state: State) -> None:
        self._memory.pop(name, None)
        room = self.options.memory_mb * 1e6 - state.nbytes
        held = sum(one.nbytes for one in self._memory.values())
        while self._memory and held > max(room, 0):
            held -= self._memory.popitem(last=False)[1].nbytes
        free = available_mb()
        if room >= 0 and (free is None or state.nbytes < free * 1e6 / 2):
            self._memory[name] = state


class _Folder:
    """States as files, shared by any number of processes without a lock.

    A file appears whole and never changes; that another process removes it is a state not found.
    """

    def __init__(self, path: Path, options: StateOptions) -> None:
        self._path, self._limit = path, options.folder_mb * 1_000_000
        self._told = False  # a folder that cannot be written is told of once

    def load(self, name: str) -> State | None:
        """Return a state that is whole; one that is not is removed."""
        for path in sorted(self._path.glob(f"{name}.*{_SUFFIX}")):
            try:
                state = np.fromfile(path, np.uint8)
            except OSError:  # gone by now, or unreadable
                continue
            if path.name == _file_name(name, state):
                with suppress(OSError):  # a folder may be read-only
                    path.touch()
                return state
            _log.warning("%s: torn or changed, thrown away; the prompt is evaluated anew", path)
            _remove(path)
        return None

    def save(self, name: str, state: State) -> None:
        """Write a state, after as many files went as make room for it."""
        if state.nbytes > self._limit:
            return
        path = self._path / _file_name(name, state)
        try:
            self._make_room(state.nbytes)
            write_atomic(path, state.data)
        except (UnwritableError, OSError) as error:
            if not self._told:
                _log.warning("states are not saved: %s", error)
            self._told = True

    def drop(self, name: str) -> None:
        """Remove a state."""
        for path in self._path.glob(f"{name}.*{_SUFFIX}"):
            _remove(path)

    def _make_room(self, size: int) -> None:
        found = []
        for path in self._path.glob(f"*{_SUFFIX}"):
            with suppress(FileNotFoundError):
                about = path.stat()
                found.append((about.st_mtime_ns, path, about.st_size))
        size += sum(one[2] for one in found)
        for _, path, its in sorted(found):
            if size <= self._limit:
                break
            _remove(path)
            size -= its
        for path in self._path.glob(f".*{_SUFFIX}.*"):  # as `write_atomic` names them
            with suppress(FileNotFoundError):
                if time.time() - path.stat().st_mtime > _LEFT_S:
                    _remove(path)


def _file_name(name: str, state: State) -> str:
    whole = hashlib.sha256(name.encode())
    whole.update(state.data)
    return f"{name}.{whole.hexdigest()}{_SUFFIX}"


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


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
