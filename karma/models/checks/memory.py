"""Estimate what a model takes, and refuse it where less memory is free."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from karma.errors import ModelError

MEMINFO = Path("/proc/meminfo")
CGROUP = Path("/sys/fs/cgroup")  # of this machine or container, version 2
_SPARE_MB = 64  # of torch, which grows with nothing we know of
_BUFFERS_MB = 12  # of llama.cpp, likewise; measured
_WORD_BYTES, _PAIR_BYTES = 230, 120  # in memory, of a token and of a merge of a vocabulary


def available_mb() -> float | None:
    """Return the memory that can be had without swapping, in MB; None where it is not known.

    What Linux calls MemAvailable, or what a container's own limit leaves if that is less.
    """
    found = [value for value in (_from_meminfo(), _from_cgroup()) if value is not None]
    return min(found, default=None)


def check_memory(
    name: str, needed_mb: float, *, parts: str, fix: str, free_mb: float | None = None
) -> None:
    """Refuse a model that does not fit; never where nothing is known of the memory.

    `parts` and `fix` are for the message: what it needs is made of, and what to do about it;
    `free_mb` is of a GPU, None: what this machine has.

    Raises:
        ModelError: less memory is available; names both figures.
    """
    whose = "memory" if free_mb is None else "GPU memory"
    free = available_mb() if free_mb is None else free_mb
    if free is not None and needed_mb > free:
        raise ModelError(
            f"{name}: needs about {needed_mb:.0f} MB of {whose} ({parts}), {free:.0f} MB are free\n"
            f"  To fix: {fix}, or free some memory"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint:
    """What a GGUF takes under llama.cpp, in MB, by parts.

    Weights are mapped from the file, so a model can be squeezed into less, at the price of reading
    it from disk for every token.
    """

    file_mb: float
    blocks: int  # layers, without the output's
    token_mb: float  # keys and values of one token
    words_mb: float  # the vocabulary, llama.cpp's and ours
    layer_mb: float  # what a batch takes in one layer, without its attention
    scores_mb: float  # of a batch's attention to one token
    logits_mb: float  # of a batch
    beside_mb: float = 0.0  # what something else takes with it, on the same device

    @classmethod
    def of(
        cls,
        path: Path,
        metadata: Mapping[str, Any],
        *,
        batch: int,
        bytes_each: float = 2,
        beside_mb: float = 0.0,
    ) -> Self:
        """Estimate it from the header, for calls of `batch` tokens."""
        words, pairs = (
            int(metadata.get(f"tokenizer.ggml.{key}") or 0) for key in ("tokens", "merges")
        )
        width = _number(metadata, "embedding_length", 1)
        inner = _number(metadata, "feed_forward_length", 4 * width)
        heads = _number(metadata, "attention.head_count", 1)
        numbers = 4 * batch / 1e6  # one of each token of a batch, in 32 bits
        return cls(
            file_mb=path.stat().st_size / 1e6,
            blocks=_number(metadata, "block_count", 1),
            token_mb=_token_mb(metadata, bytes_each),
            words_mb=(_WORD_BYTES * words + _PAIR_BYTES * pairs) / 1e6,
            layer_mb=numbers * (3 * inner + 2 * width),
            scores_mb=numbers * (heads + 1),
            logits_mb=numbers * words,
            beside_mb=beside_mb,
        )

    def layers_mb(self, context: int) -> float:
        """Return what the file and keys and values of so many tokens take."""
        return self.file_mb + context * self.token_mb

    def work_mb(self, context: int, *, on_gpu: bool = False) -> float:
        """Return what computing takes beside them, with a context of so many tokens.

        llama.cpp reserves logits for every token of a batch. As only the last one's are asked for,
        they take memory on a GPU alone, which gives all that is reserved.
        """
        batch = self.layer_mb + context * self.scores_mb
        own = max(batch, self.logits_mb) if on_gpu else batch + self.words_mb
        return _BUFFERS_MB + self.beside_mb + own


def projector_mb(path: Path) -> float:
    """Estimate what a picture projector takes: its file, as much to compute, and buffers."""
    return 2 * path.stat().st_size / 1e6 + _SPARE_MB


def gguf_parts_mb(
    path: Path, metadata: Mapping[str, Any], *, context: int, batch: int, bytes_each: float = 2
) -> float:
    """Estimate what a GGUF takes under llama.cpp with a context of so many tokens, in MB."""
    size = Footprint.of(path, metadata, batch=batch, bytes_each=bytes_each)
    return size.layers_mb(context) + size.work_mb(context)


def _token_mb(metadata: Mapping[str, Any], bytes_each: float) -> float:
    """Estimate what the keys and values of a token take under llama.cpp, in MB."""
    heads = _number(metadata, "attention.head_count", 1)
    per_head = _number(metadata, "embedding_length", 1) // heads
    row = sum(_number(metadata, f"attention.{one}_length", per_head) for one in ("key", "value"))
    # an array (heads that differ by layer) is read as its length, so never more than all heads
    groups = min(_number(metadata, "attention.head_count_kv", heads), heads)
    return bytes_each * _number(metadata, "block_count", 1) * groups * row / 1e6


def _number(metadata: Mapping[str, Any], key: str, default: int) -> int:
    value = metadata.get(f"{metadata['general.architecture']}.{key}")
    return value if isinstance(value, int) and value > 0 else default


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
