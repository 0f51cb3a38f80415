"""A GPU for tests where there is none: llama.cpp's RPC device, served on this machine's CPU.

To llama.cpp it is a device like a card: layers, keys and values go to its memory, in another
process, and kernels run there. Not the same: its kernels are the CPU's, so bits are too.

llama.cpp ends a process that frees a model whose server is gone, so a server lives until the
process that has started it ends. It serves one process only, and llama.cpp keeps a device for as
long as the process lives: so tests that need one have a process of their own.
"""

import ctypes
import os
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_PATIENCE_S = 30.0


@dataclass(frozen=True, kw_only=True)
class RpcDevice:
    """One that runs."""

    address: str
    process: int

    def memory_mb(self) -> float:
        """What its process holds, resident."""
        lines = Path(f"/proc/{self.process}/status").read_text().splitlines()
        (kilobytes,) = (line.split()[1] for line in lines if line.startswith("VmRSS:"))
        return int(kilobytes) * 1024 / 1e6


@cache
def rpc_device() -> RpcDevice:
    """The GPU of this process, which llama.cpp knows from then on."""
    from llama_cpp.llama_cpp import _lib

    device = start()
    _lib.ggml_backend_rpc_add_server.restype = ctypes.c_void_p
    _lib.ggml_backend_rpc_add_server.argtypes = [ctypes.c_char_p]
    _lib.ggml_backend_register.argtypes = [ctypes.c_void_p]
    _lib.ggml_backend_register(_lib.ggml_backend_rpc_add_server(device.address.encode()))
    return device


def start() -> RpcDevice:
    """Start a server in a process of its own, which ends when ours does."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{one.getsockname()[1]}"
    read, _open_until_we_end = os.pipe()
    process = subprocess.Popen(
        [sys.executable, __file__, address],
        stdin=read, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(read)
    host, port = address.split(":")
    until = time.monotonic() + _PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        try:
            socket.create_connection((host, int(port))).close()
        except OSError:
            time.sleep(0.05)
        else:
            return RpcDevice(address=address, process=process.pid)
    raise RuntimeError(f"no RPC device came up at {address}")


def _serve(address: str) -> None:
    """Serve the CPU as a device, until nobody holds the other end of our input."""
    from llama_cpp.llama_cpp import _lib

    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    _lib.ggml_backend_dev_by_name.restype = ctypes.c_void_p
    devices = (ctypes.c_void_p * 1)(_lib.ggml_backend_dev_by_name(b"CPU"))
    _lib.ggml_backend_rpc_start_server.argtypes = [
        ctypes.c_char_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_size_t, ctypes.c_void_p,
    ]  # fmt: skip
    _lib.ggml_backend_rpc_start_server(address.encode(), None, 1, 1, devices)


if __name__ == "__main__":
    _serve(sys.argv[1])
