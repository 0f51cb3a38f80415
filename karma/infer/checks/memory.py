"""Estimate what a model takes, and refuse it where less memory is free."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from karma.errors import ModelError

MEMINFO = Path("/proc/meminfo")
CGROUP = Path("/sys/fs/cgroup")  # of this machine or container, version 2
_SPARE_MB = 64  # buffers that grow with nothing we know of


def available_mb() -> float | None:
    """Return the memory that can be had without swapping, in MB; None where it is not known.

    What Linux calls MemAvailable, or what a container's own limit leaves if that is less.
    """
    found = [value for value in (_from_meminfo(), _from_cgroup()) if value is not None]
    return min(found, default=None)


def check_memory(name: str, needed_mb: float, *, parts: str, fix: str) -> None:
    """Refuse a model that does not fit.

    Args:
        name: the model, or the file or folder it is in.
        needed_mb: what it takes once loaded.
        parts: what that is made of, for the message.
        fix: what to do about it, for the message.

    Raises:
        ModelError: less memory is available; names both figures. Never where nothing is known.
    """
    free = available_mb()
    if free is not None and needed_mb > free:
        raise ModelError(
            f"{name}: needs about {needed_mb:.0f} MB of memory ({parts}), {free:.0f} MB are free\n"
            f"  To fix: {fix}, or free some memory"
        )


def gguf_parts_mb(
    path: Path, metadata: Mapping[str, Any], *, context: int, batch: int, bytes_each: int = 2
) -> float:
    """Estimate what a GGUF takes under llama.cpp, in MB.

    The file, keys and values of `context` tokens, of so many bytes each, and one row of logits per
    token of a batch. Weights are mapped from the file, so a model can be squeezed into less, at the
    price of reading it from disk for every token.
    """
    logits = 4 * batch * int(metadata.get("tokenizer.ggml.tokens") or 0)
    cache_mb = kept_mb(metadata, context, bytes_each=bytes_each)
    return (path.stat().st_size + logits) / 1e6 + cache_mb + _SPARE_MB


def kept_mb(metadata: Mapping[str, Any], tokens: int, *, bytes_each: int = 2) -> float:
    """Estimate what the keys and values of so many tokens take under llama.cpp, in MB."""
    architecture = metadata["general.architecture"]

    def number(key: str, default: int) -> int:
        value = metadata.get(f"{architecture}.{key}")
        return value if isinstance(value, int) and value > 0 else default

    heads = number("attention.head_count", 1)
    per_head = number("embedding_length", 1) // heads
    row = number("attention.key_length", per_head) + number("attention.value_length", per_head)
    # an array (heads that differ by layer) is read as its length, so never more than all heads
    groups = min(number("attention.head_count_kv", heads), heads)
    return bytes_each * number("block_count", 1) * groups * row * tokens / 1e6


def weights_mb(parameters: int, *, bytes_each: int = 4) -> float:
    """Return what so many parameters take once loaded, in MB, with room for one forward pass."""
    return parameters * bytes_each * 1.1 / 1e6 + _SPARE_MB


def _from_meminfo() -> float | None:
    try:
        lines = MEMINFO.read_text().splitlines()
        found = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
        return int(found[0]) * 1024 / 1e6
    except (OSError, ValueError, IndexError):
        return None


def _from_cgroup() -> float | None:
    try:
        limit = int((CGROUP / "memory.max").read_text())
        used = int((CGROUP / "memory.current").read_text())
        caches = (CGROUP / "memory.stat").read_text().splitlines()
        clean = [int(line.split()[1]) for line in caches if line.startswith("inactive_file ")]
        return (limit - used + sum(clean)) / 1e6
    except (OSError, ValueError, IndexError):  # no limit reads "max"
        return None
