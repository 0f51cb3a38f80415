"""What a server may take of this machine: so much time for a whole answer, and so many bytes.

A client's own timeouts hold for each read, so a server that sends a byte a second never meets one.
Here the clock runs from the request to the answer's last byte, headers included, and bytes are
counted as they come off the wire. Packed answers are refused: they unpack to any size. Not bounded:
the look-up of the server's name, which is the operating system's.
"""

import ssl
import time
from collections.abc import Callable
from typing import Any

LARGEST_ANSWER = 32 << 20  # bytes, headers included
_PIECE = 1 << 14  # bytes that are written at once


def bounded_transport(*, total_s: float, verify: bool, most: int = LARGEST_ANSWER) -> Any:
    """Return a transport for the client of the `openai` package; no proxy from the environment.

    Args:
        total_s: for one request and its whole answer.
        verify: whether certificates are needed, and read.
        most: bytes of an answer.
    """
    import httpcore2
    import httpx2

    meter = _Meter(total_s, most, httpcore2.ReadTimeout, httpcore2.ReadError)
    transport = httpx2.HTTPTransport(verify=verify, trust_env=False)
    context = ssl.create_default_context() if verify else None
    network: Any = _MeteredNetwork(httpcore2.SyncBackend(), meter)
    transport._pool = httpcore2.ConnectionPool(ssl_context=context, network_backend=network)
    return _Bounded(transport, meter, httpx2.DecodingError)


class _Meter:
    """What is left of one request's time and bytes."""

    def __init__(
        self,
        total_s: float,
        most: int,
        late: Callable[[str], Exception],
        large: Callable[[str], Exception],
    ) -> None:
        self._total_s, self._most, self._late, self._large = total_s, most, late, large
        self._until, self._left = 0.0, most

    def begin(self) -> None:
        self._until, self._left = time.monotonic() + self._total_s, self._most

    def wait(self, timeout_s: float | None) -> float:
        """Return how long the next step may take."""
        left = self._until - time.monotonic()
        if left <= 0:
            raise self._late(f"timed out: no whole answer within {self._total_s:g} s")
        return left if timeout_s is None else min(left, timeout_s)

    def take(self, count: int) -> None:
        """Count bytes that have come."""
        self._left -= count
        if self._left < 0:
            raise self._large(f"the answer has more than {self._most >> 20} MiB")


class _MeteredNetwork:
    """Connections whose every step is metered; as httpcore wants a network."""

    def __init__(self, inner: Any, meter: _Meter) -> None:
        self._inner, self._meter = inner, meter

    def connect_tcp(
        self, host: str, port: int, timeout: float | None = None, **more: Any
    ) -> "_MeteredStream":
        wait_s = self._meter.wait(timeout)
        return _MeteredStream(
            self._inner.connect_tcp(host, port, timeout=wait_s, **more), self._meter
        )

    def sleep(self, seconds: float) -> None:
        self._inner.sleep(seconds)


class _MeteredStream:
    """One connection."""

    def __init__(self, inner: Any, meter: _Meter) -> None:
        self._inner, self._meter = inner, meter

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        data: bytes = self._inner.read(max_bytes, timeout=self._meter.wait(timeout))
        self._meter.take(len(data))
        return data

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        for start in range(0, len(buffer), _PIECE):
            piece = buffer[start : start + _PIECE]
            self._inner.write(piece, timeout=self._meter.wait(timeout))

    def close(self) -> None:
        self._inner.close()

    def start_tls(
        self, ssl_context: ssl.SSLContext, server_hostname: Any = None, timeout: Any = None
    ) -> "_MeteredStream":
        wait_s = self._meter.wait(timeout)
        inner = self._inner.start_tls(ssl_context, server_hostname, timeout=wait_s)
        return _MeteredStream(inner, self._meter)

    def get_extra_info(self, info: str) -> Any:
        return self._inner.get_extra_info(info)


class _Bounded:
    """A transport that starts the meter with every request, and refuses packed answers."""

    def __init__(self, inner: Any, meter: _Meter, packed: Callable[[str], Exception]) -> None:
        self._inner, self._meter, self._packed = inner, meter, packed

    def __enter__(self) -> "_Bounded":
        self._inner.__enter__()
        return self

    def __exit__(self, *failure: Any) -> None:
        self._inner.__exit__(*failure)

    def handle_request(self, request: Any) -> Any:
        self._meter.begin()
        response = self._inner.handle_request(request)
        coding = response.headers.get("content-encoding", "identity")
        if coding.lower() not in ("", "identity"):
            response.close()
            raise self._packed(f"the answer is packed ({coding[:20]}), which nobody asked for")
        return response

    def close(self) -> None:
        self._inner.close()
