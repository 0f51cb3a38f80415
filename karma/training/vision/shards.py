"""What training reads: crops of many rooms, drawn once, kept as shards of PNG pictures on disk."""

import io
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from karma.files import read_json, to_json, write_atomic
from karma.infer.vision.pictures import cut
from karma.training.vision.moments import generator, lessons, moments, room

ROOMS = 40  # per shard
STATES, VIEWS = 3, 14  # dealings per room, views per dealing
LONGEST_PX = 160  # larger crops are stored smaller
SPARE = 1.2  # crops are stored so much wider than they are shown, to be shifted and scaled


class CropRow(msgspec.Struct, frozen=True, array_like=True):
    """One crop of a shard: what it shows, and where its bytes lie."""

    object_type: str
    states: tuple[str, ...]
    pixels: int
    start: int
    end: int


class Shard:
    """One shard in its two files, NNNN.json and NNNN.bin; crops are decoded when asked for."""

    def __init__(self, folder: Path, number: int) -> None:
        self.rows = read_json(folder / f"{number:04}.json", list[CropRow])
        self._bytes = np.memmap(folder / f"{number:04}.bin", dtype=np.uint8, mode="r")

    def picture(self, row: int) -> "np.ndarray":
        """Return a stored crop, uint8 (s, s, 3)."""
        from PIL import Image

        one = self.rows[row]
        with Image.open(io.BytesIO(self._bytes[one.start : one.end].tobytes())) as picture:
            return np.asarray(picture.convert("RGB"))


def write_shard(folder: Path, number: int, *, seed: int, margin: float) -> int:
    """Draw one shard and write it; equal arguments give equal bytes. Returns its rows."""
    blob, rows = io.BytesIO(), []
    for row, data in _rows(number, seed, margin):
        start = blob.tell()
        blob.write(data)
        rows.append(CropRow(row[0], row[1], row[2], start, blob.tell()))
    write_atomic(folder / f"{number:04}.bin", blob.getvalue())
    write_atomic(folder / f"{number:04}.json", to_json(rows))  # last: a shard is whole with it
    return len(rows)


def has_shard(folder: Path, number: int) -> bool:
    """Return whether a shard was written to the end."""
    return (folder / f"{number:04}.json").exists()


def _rows(
    number: int, seed: int, margin: float
) -> Iterator[tuple[tuple[str, tuple[str, ...], int], bytes]]:
    for which in range(number * ROOMS, (number + 1) * ROOMS):
        rng = generator(seed, "room", str(which))
        for event in moments(room(seed, which), rng, states=STATES, views=VIEWS):
            for sample in lessons(event, rng):
                crop = cut(event.frame, sample.region, margin * SPARE, sample.silhouette)
                yield (sample.object_type, sample.states, sample.pixels), _png(crop)


def _png(crop: "np.ndarray") -> bytes:
    from PIL import Image

    picture = Image.fromarray(crop)
    if len(crop) > LONGEST_PX:
        picture = picture.resize((LONGEST_PX, LONGEST_PX), Image.Resampling.BILINEAR)
    data = io.BytesIO()
    picture.save(data, "PNG", compress_level=1)
    return data.getvalue()
