"""First-person pictures for a page: each different picture once, small, as text."""

import hashlib
import io
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor

from karma.bench.report.html import data_uri
from karma.contracts import Frame

QUALITY = 72  # of WebP: about 3 kB for 300 x 300 pixels of a drawn room


class Frames:
    """Pictures in the order they were first seen; equal ones share a number."""

    def __init__(self) -> None:
        self._numbers: dict[bytes, int] = {}
        self._seen: dict[Hashable, int] = {}
        self._webp: list[Future[bytes]] = []
        self._packing = ThreadPoolExecutor(1)  # while the next one is drawn

    def of(self, moment: Hashable, draw: Callable[[], Frame | None]) -> int:
        """Return the number of a moment's picture, drawn if no equal moment was; -1 without one."""
        if moment not in self._seen:
            frame = draw()
            self._seen[moment] = -1 if frame is None else self.add(frame)
        return self._seen[moment]

    def add(self, frame: Frame) -> int:
        """Keep a picture; returns its number."""
        key = hashlib.blake2b(frame.tobytes(), digest_size=16).digest()
        if key not in self._numbers:
            self._numbers[key] = len(self._webp)
            self._webp.append(self._packing.submit(webp, frame.copy()))
        return self._numbers[key]

    def __len__(self) -> int:
        """Return the number of different pictures."""
        return len(self._webp)

    def uris(self) -> list[str]:
        """Return each as a data URI."""
        return [data_uri("image/webp", one.result()) for one in self._webp]


def webp(frame: Frame) -> bytes:
    """Return a picture as a WebP file; equal pictures give equal bytes."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(frame).save(file, "WEBP", quality=QUALITY, method=4)
    return file.getvalue()
