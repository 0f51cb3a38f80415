"""What a server may take of this machine: so much time for a whole answer, and so many bytes.

A client's own timeouts hold for each read, so a server that sends a byte a second never meets one.
Here the clock runs from the request to the answer's last byte, headers included, and bytes are
counted as they come off the wire. Packed answers are refused: they unpack to any size. Not bounded:
the look-up of the server's name, which is the operating system's.
"""

import ssl
import time
from typing import Any

LARGEST_ANSWER = 32 << 20  # bytes, headers included
_PIECE = 1 << 14  # bytes that are written at once


def bounded(*, total_s: float, verify: bool) -> dict[str, Any]:
    """Return what bounds an HTTP client of the `openai` package; no proxy from the environment.

    `total_s` is for one request and its whole answer; certificates are read only to `verify`.
    """
    import httpcore2
    import httpx2

    meter = _Meter(total_s)
    transport = httpx2.HTTPTransport(verify=verify, trust_env=False)
    context = ssl.create_default_context() if verify else None
    network: Any = _Metered(httpcore2.SyncBackend(), meter)
    transport._pool = httpcore2.ConnectionPool(ssl_context=context, network_backend=network)
    hooks = {"request": [lambda _: meter.begin()], "response": [_refuse_packed]}
    return {"transport": transport, "event_hooks": hooks}


def _refuse_packed(response: Any) -> None:
    import httpx2

    coding = response.headers.get("content-encoding", "identity")
    if coding.lower() not in ("", "identity"):
        said = f"the answer is packed ({coding[:20]}), which nobody asked for"
        raise httpx2.DecodingError(said)


class _Meter:
    """What is left of one request's time and bytes."""

    def __init__(self, total_s: float) -> None:
        self._total_s, self._until, self._left = total_s, 0.0, LARGEST_ANSWER

    def begin(self) -> None:
        self._until, self._left = time.monotonic() + self._total_s, LARGEST_ANSWER

    def wait(self, timeout_s: float | None) -> float:
        """Return how long the next step may take."""
        import httpcore2

        left = self._until - time.monotonic()
        if left <= 0:
            raise httpcore2.ReadTimeout(f"timed out: no whole answer within {self._total_s:g} s")
        return left if timeout_s is None else min(left, timeout_s)

    def take(self, count: int) -> None:
        """Count bytes that have come."""
        import httpcore2

        self._left -= count
        if self._left < 0:
            raise httpcore2.ReadError(f"the answer has more than {LARGEST_ANSWER >> 20} MiB")


class _Metered:
    """A network of httpcore's, or a connection, whose every step is metered."""

    def __init__(self, inner: Any, meter: _Meter) -> None:
        self._inner, self._meter = inner, meter

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)  # what waits for nobody

    def connect_tcp(self, *place: Any, timeout: float | None = None, **more: Any) -> "_Metered":
        wait_s = self._meter.wait(timeout)
        return _Metered(self._inner.connect_tcp(*place, timeout=wait_s, **more), self._meter)

    def start_tls(self, *how: Any, timeout: float | None = None, **more: Any) -> "_Metered":
        wait_s = self._meter.wait(timeout)
        return _Metered(self._inner.start_tls(*how, timeout=wait_s, **more), self._meter)

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        data: bytes = self._inner.read(max_bytes, timeout=self._meter.wait(timeout))
        self._meter.take(len(data))
        return data

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        for start in range(0, len(buffer), _PIECE):
            piece = buffer[start : start + _PIECE]
            self._inner.write(piece, timeout=self._meter.wait(timeout))
