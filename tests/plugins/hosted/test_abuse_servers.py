"""A malicious or broken server takes no more than it was given, and its key is kept nowhere."""

import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from support.abuse import Case, all_held, stream
from support.hosted_server import KEY, PROMPT, endpoint, need_loopback

from karma.errors import ModelError
from karma.models.session import Session
from karma.plugins.hosted.cassette import Cassette
from karma.plugins.hosted.connection import LARGEST_ANSWER
from karma.plugins.hosted.model import HostedEmbedder, HostedLanguageModel

Speak = Callable[[socket.socket], None]
PATIENCE_S = 0.4  # of the client; a server that goes on for ever is left after that
_CHUNKED = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n"
_JSON = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"


def sized(body: bytes, *, status: str = "200 OK", more: str = "") -> Speak:
    head = f"HTTP/1.1 {status}\r\nContent-Type: application/json\r\n{more}"
    return lambda to: to.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)


def said(content: object, **more: object) -> bytes:
    message = {"role": "assistant", "content": content}
    choice = {"index": 0, "finish_reason": "stop", "message": message}
    return json.dumps({"model": "m", "choices": [choice], **more}).encode()


def on_and_on(first: bytes, again: bytes, pause_s: float = 0.0) -> Speak:
    """Return a server that never ends, unless the other side goes."""

    def speak(to: socket.socket) -> None:
        to.sendall(first)
        while True:
            to.sendall(again)
            time.sleep(pause_s)

    return speak


_CHUNK = b"10000\r\n" + b" " * 65536 + b"\r\n"
ENDLESS: dict[str, Speak] = {
    "endless body": on_and_on(_JSON + b"Transfer-Encoding: chunked\r\n\r\n", _CHUNK),
    "endless body without a length": on_and_on(_JSON + b"Connection: close\r\n\r\n", b"[" * 65536),
    "huge body": on_and_on(_JSON + b"Content-Length: 99999999999\r\n\r\n", b'"' + b"x" * 65536),
    "endless headers": on_and_on(_JSON, b"X-More: " + b"x" * 8000 + b"\r\n"),
    "endless line": on_and_on(b"HTTP/1.1 200 ", b"x" * 65536),
    "endless 100 Continue": on_and_on(b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
    "slow 100 Continue": on_and_on(b"", b"HTTP/1.1 100 Continue\r\n\r\n", 0.02),
    "endless 103 hints": on_and_on(b"", b"HTTP/1.1 103 Early Hints\r\nLink: x\r\n\r\n"),
    "trickled body": on_and_on(_JSON + b"Content-Length: 99999\r\n\r\n", b" ", 0.02),
    "trickled headers": on_and_on(_JSON, b"X", 0.02),
    "trickled chunks": on_and_on(_CHUNKED, b"1\r\n \r\n", 0.02),
    "nothing ever": on_and_on(b"", b"", 0.02),
    "endless chunk extension": on_and_on(_CHUNKED + b"1;", b"x" * 9000),
    "too large by one": sized(b" " * (LARGEST_ANSWER + 1)),
}  # fmt: skip

_PACKED = {"gzip": b"\x1f\x8b\x08" + bytes(99), "deflate": b"x\x9c" + bytes(99), "br": bytes(99)}
BROKEN: dict[str, Speak] = {
    **{f"packed by {n}": sized(b, more=f"Content-Encoding: {n}\r\n") for n, b in _PACKED.items()},
    "redirection": sized(b"", status="302 Found", more="Location: http://192.0.2.1/\r\n"),
    "redirection to a file": sized(b"", status="307 X", more="Location: file:///etc/x\r\n"),
    "to itself": sized(b"", status="308 X", more="Location: /v1/chat/completions\r\n"),
    "Retry-After of years": sized(b"{}", status="400 X", more="Retry-After: 999999999999\r\n"),
    "busy for years": sized(b"{}", status="429 X", more="Retry-After: 999999999999\r\n"),
    "busy till a date": sized(b"{}", status="503 X", more="Retry-After: Fri, 31 Dec 9999\r\n"),
    "server error": sized(b"\x1b[2J", status="500 \x1b[2J"),
    "no such status": sized(b"{}", status="999 X"),
    "no content": sized(b"", status="204 No Content"),
    "wrong length": lambda to: to.sendall(_JSON + b"Content-Length: 5\r\n\r\n" + said("x")),
    "negative length": lambda to: to.sendall(_JSON + b"Content-Length: -5\r\n\r\n{}"),
    "two lengths": sized(b"{}", more="Content-Length: 3\r\n"),
    "no HTTP": lambda to: to.sendall(b"SSH-2.0-x\r\n" + bytes(99)),
    "cut off": lambda to: to.sendall(_JSON + b"Content-Length: 999\r\n\r\n{"),
    "hanging up": lambda to: None,
    "bad chunk": lambda to: to.sendall(_JSON + b"Transfer-Encoding: chunked\r\n\r\nZZ\r\nx\r\n"),
}  # fmt: skip

_VALUES: tuple[object, ...] = (
    None, 7, -1e308, True, [], {}, "", "x", [[]], {"a": 1}, ["x"], 10**400, "\x1b[2J", "[/red]",
    {"choices": []}, [None], 1.5, {"message": None}, "\x00",
)  # fmt: skip
BODIES: dict[str, bytes] = {
    "deep lists": b'{"choices":' + b"[" * 200_000,
    "deep objects": b'{"choices":' * 100_000,
    "deep and closed": b'{"choices":' + b"[" * 5_000 + b"]" * 5_000 + b"}",
    "lone surrogate": rb'{"choices":[{"message":{"content":"\ud800"}}]}',
    "lone surrogate as a name": rb'{"\udfff":1,"choices":[]}',
    "NaN": b'{"choices":[{"message":{"content":NaN}}]}',
    "no UTF-8": b'{"choices":"\xff\xfe"}',
    "empty": b"",
    "a list": b"[]",
    "a number": b"1e999",
    "two objects": b"{}{}",
    "names twice": b'{"choices":1,"choices":[]}',
    "endless number": b'{"choices":' + b"9" * 100_000 + b"}",
    "zeros": bytes(1000),
    "HTML": b"<html><script>owned()</script></html>",
}


def _wrong_types(number: int) -> bytes:
    """Return an answer in which one part is of another type."""
    value = _VALUES[number % len(_VALUES)]
    whole: dict[str, object] = json.loads(said("GoToObject(robot, 'Apple')", usage={}))
    choice = whole["choices"][0]  # type: ignore[index]
    match number // len(_VALUES) % 8:
        case 0:
            whole["choices"] = value
        case 1:
            whole["choices"] = [value]
        case 2:
            choice["message"] = value
        case 3:
            choice["message"]["content"] = value
        case 4:
            choice["finish_reason"] = value
        case 5:
            whole["usage"] = value
        case 6:
            whole["usage"] = {"prompt_tokens": value, "completion_tokens": value}
        case _:
            whole["model"] = value
    return json.dumps(whole).encode()


@contextmanager
def speaking(speak: Speak) -> Iterator[str]:
    """Serve one connection after the other; yields the base URL."""
    need_loopback()
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(0.1)
    over, open_now = threading.Event(), set()

    def serve() -> None:
        while not over.is_set():
            with suppress(OSError):
                to, _ = server.accept()
                to.settimeout(5)
                open_now.add(to)
                with to, suppress(OSError):
                    to.recv(65536)
                    speak(to)
                open_now.discard(to)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.getsockname()[1]}/v1"
    finally:
        over.set()
        for one in tuple(open_now):  # whatever it still says, nobody listens
            one.close()
        thread.join()
        server.close()


def servers(seed: int, count: int) -> Iterator[Case]:
    """Yield servers that are endless, broken, of wrong types, or say the key."""
    rng = stream(seed, "servers")
    whole = [(name, speak) for group in (ENDLESS, BROKEN) for name, speak in group.items()]
    whole += [(name, sized(body)) for name, body in BODIES.items()]
    whole.append(("key", sized(said(f"your key is {KEY}!"))))
    for number in range(count):
        name, speak = (
            whole[number] if number < len(whole)
            else ("wrong types", sized(_wrong_types(rng.randrange(10_000))))
        )  # fmt: skip
        yield Case(name=f"{name} {number}", attack=_asked(speak))


def _asked(speak: Speak) -> Callable[[Path], None]:
    def attack(folder: Path) -> None:
        os.environ["OPENAI_API_KEY"] = KEY
        try:
            with speaking(speak) as url:
                place = endpoint(url, retries=0, timeout_s=PATIENCE_S)
                for ask in (_planner, _embedder):
                    _left_no_key(lambda: ask(place, folder), folder)  # noqa: B023
        finally:
            del os.environ["OPENAI_API_KEY"]

    return attack


def _planner(place: object, folder: Path) -> object:
    session = Session(Cassette(folder, "record"))
    return HostedLanguageModel(place, session=session).complete(PROMPT)  # type: ignore[arg-type]


def _embedder(place: object, folder: Path) -> object:
    return HostedEmbedder(place).embed(["apple"])  # type: ignore[arg-type]


def _left_no_key(act: Callable[[], object], folder: Path) -> None:
    try:
        shown = repr(act())
    except ModelError as error:
        shown = str(error)
        assert len(shown) < 2000
    tape = folder / "exchanges.jsonl"
    kept = tape.read_text() if tape.exists() else ""
    assert len(kept) < 1 << 20, "an answer of any size is kept"
    assert KEY not in shown
    assert KEY not in kept


def test_servers_without_end_or_manners_are_bounded_and_the_key_is_kept_nowhere(tmp_path):
    all_held(servers, 90, tmp_path)
