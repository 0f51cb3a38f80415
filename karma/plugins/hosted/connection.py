"""Reach an OpenAI-compatible endpoint with its key, and put what it answers on tape and bill.

Covered: the key stays in the environment and in one HTTP header; it is taken out of everything
that comes back before anybody sees it. Not covered: what the host does with what it is sent.

A server may take so much time for a whole answer, and so many bytes. A client's own timeouts hold
for each read, so a server that sends a byte a second never meets one. Here the clock runs from the
request to the answer's last byte, headers included, and bytes are counted as they come off the
wire. Packed answers are refused: they unpack to any size. Not bounded: the look-up of the server's
name, which is the operating system's.
"""

import logging
import os
import re
import ssl
from collections.abc import Mapping
from time import monotonic, sleep
from typing import Any
from urllib.parse import urlsplit

import msgspec

from karma.errors import ModelError, RequestRefused, ServerLost
from karma.models.completeness import CUTS, ENDS
from karma.models.endpoint import Endpoint
from karma.models.session import CassetteError, Session, Spent
from karma.offline.guard import allow_host
from karma.plugins.hosted.cassette import Cassette, Exchange, Reply
from karma.plugins.hosted.keys import Key
from karma.plugins.hosted.usage import Usage, cost_of, usage_of

_KEY = re.compile(r"[!-~]+")
_ANY_ADDRESS = ("0.0.0.0", "::")  # that a server prints which listens to all: it is this machine
_NOTHING = Usage(prompt_tokens=0, completion_tokens=0)  # what a failure takes
_LONGEST_MESSAGE = 500
LARGEST_ANSWER = 32 << 20  # bytes, headers included
_PIECE = 1 << 14  # bytes that are written at once
_NO_LEAVE = (401, 403)  # HTTP
_BUSY = frozenset({*_NO_LEAVE, 402, 408, 409, 425, 429})  # HTTP: not now, or not with this key
_PAUSE_S = 0.5  # before it is asked again for what stands in a body; then twice as long
_REFUSED = ("HTTP 400", "HTTP 413", "HTTP 422")  # what was asked, e.g. too long or improper


class Connection:
    """Ask endpoints on behalf of one session: recorded, billed, and without the key."""

    def __init__(self, session: Session | None = None) -> None:
        self.session = session or Session()
        recorded = self.session.cassette
        self._cassette = recorded if isinstance(recorded, Cassette) else Cassette()
        self._clients: dict[tuple[str, str, float, int], Any] = {}

    def admit(self, endpoint: Endpoint) -> None:
        """Check, before anything is asked, that an endpoint may be and can be reached.

        A replay reaches nothing, so it needs neither leave nor key. Whether a server wants a key it
        says itself.

        Raises:
            KarmaError: it is on another machine and there is no --allow-network.
            ModelError: what its variable holds is no key, or there is no `openai` package.
        """
        if self.session.cassette.mode == "replay":
            return
        if endpoint.host not in _ANY_ADDRESS:
            allow_host(endpoint.host)
        _key(endpoint)
        _openai()

    def ask(
        self,
        role: str,
        endpoint: Endpoint,
        path: str,
        body: Mapping[str, Any],
        *,
        named: Mapping[str, Any] | None = None,
        shared: bool = False,
    ) -> Exchange:
        """Ask once and return the exchange; its reply has an answer.

        `role` ("planner", "vision", "embedder") is for the bill. A path such as "../tokenize" lies
        beside /v1. `named` is recorded in place of a large body; `shared`: equal bodies have equal
        answers.

        Raises:
            ModelError: the endpoint failed; never holds the key.
            RequestRefused: it does not take what was asked; likewise.
            ServerLost: it cannot be reached, says nothing in time, or takes no more requests.
            CassetteError: see `Cassette.exchange`.
        """
        kept = {"path": path, **(body if named is None else named)}
        exchange = self._exchange(endpoint, path, body, kept, shared=shared)
        self._enter(role, endpoint, exchange)
        if exchange.reply.answer is None:
            reason = str(exchange.reply.failure)
            kind = RequestRefused if reason.startswith(_REFUSED) else ModelError
            raise kind(f"{endpoint.model} at {endpoint.host}: {reason}")
        return exchange

    def look(self, endpoint: Endpoint, path: str) -> dict[str, Any] | None:
        """Return what a page of the server says; None where there is none, or none was recorded.

        ServerLost where the server cannot be reached.
        """
        try:
            kept = {"method": "GET", "path": path}
            return self._exchange(endpoint, path, None, kept).reply.answer
        except CassetteError:
            if self.session.cassette.mode == "replay":
                return None
            raise

    def _exchange(
        self,
        endpoint: Endpoint,
        path: str,
        body: Mapping[str, Any] | None,
        kept: Mapping[str, Any],
        *,
        shared: bool = False,
    ) -> Exchange:
        key = Key() if self.session.cassette.mode == "replay" else _key(endpoint)
        self._cassette.scope = self.session.cassette.scope
        return self._cassette.exchange(
            key.out_of(kept),
            lambda: self._sent(endpoint, key, path, body),
            url=key.out_of(endpoint.base_url),
            shared=shared,
        )

    def _enter(self, role: str, endpoint: Endpoint, exchange: Exchange) -> None:
        """Put an exchange on the bill of the episode that it was made in."""
        if exchange.scope != self.session.cassette.scope:
            return
        answer = exchange.reply.answer
        usage = _NOTHING if answer is None else usage_of(answer)
        new = Spent(
            role=role, model=str((answer or {}).get("model") or endpoint.model),
            requests=1, failures=int(answer is None),
            prompt_tokens=usage.prompt_tokens, completion_tokens=usage.completion_tokens,
            cost=cost_of(usage, endpoint.prices), seconds=exchange.seconds,
        )  # fmt: skip
        self.session.ledger.enter(new)

    def _sent(
        self, endpoint: Endpoint, key: Key, path: str, body: Mapping[str, Any] | None
    ) -> Reply:
        """Send a body, or ask for a page where there is none."""
        reply = self._send(endpoint, key, path, body)
        for attempt in range(endpoint.retries):  # the client asks again for what HTTP tells
            if not isinstance(reply, _BrokenReply):
                break
            sleep(_PAUSE_S * 2**attempt)
            reply = self._send(endpoint, key, path, body)
        if isinstance(reply, ServerLost):  # raised here, it holds no request with its headers
            raise reply
        return reply

    def _send(
        self, endpoint: Endpoint, key: Key, path: str, body: Mapping[str, Any] | None
    ) -> Reply | ServerLost:
        openai = _openai()
        import httpx2

        client = self._client(endpoint, key)
        url = f"{endpoint.root}{path[2:]}" if path.startswith("../") else path
        try:
            if body is None:
                said = client.get(url, cast_to=httpx2.Response, options={"max_retries": 1})
            else:
                said = client.post(url, cast_to=httpx2.Response, body=dict(body))
        except openai.APIStatusError as error:
            status = error.status_code
            reason = f"HTTP {status}: {_words(error.response.content) or error.message}"
            if status == 404:
                reason += (
                    f" (is {endpoint.base_url!r} right, up to /v1, and {endpoint.model!r} there?)"
                )
            dead = status == 500 and "engine" in str(error.message).lower()  # vLLM's
            may_yet_ask = body is None and status in _NO_LEAVE
            lost = not may_yet_ask and (status in _BUSY or status > 501 or dead)
        except openai.APIConnectionError as error:  # timeouts too
            reason, lost = f"{error.message} {error.__cause__ or ''}".strip(), True
        except openai.OpenAIError as error:
            reason, lost = f"{type(error).__name__}: {error}", False
        else:
            return _read(said.content, endpoint, key, asked=body is not None)
        return _lost(endpoint, reason, key) if lost else Reply(failure=_brief(reason, key))

    def _client(self, endpoint: Endpoint, key: Key) -> Any:
        """Return the client of an endpoint: no proxy, no redirection, no name of a customer."""
        name = (endpoint.base_url, endpoint.key_variable, endpoint.timeout_s, endpoint.retries)
        if name not in self._clients:
            openai = _openai()
            plain = urlsplit(endpoint.base_url).scheme == "http"  # needs no certificates read
            logging.getLogger("httpcore2").setLevel(logging.INFO)  # below, it shows headers
            limits = _bounded(total_s=endpoint.timeout_s, verify=not plain)
            http = openai.DefaultHttpxClient(trust_env=False, follow_redirects=False, **limits)
            client = openai.OpenAI(
                base_url=endpoint.base_url, api_key=key.for_header(), timeout=endpoint.timeout_s,
                max_retries=endpoint.retries, http_client=http,
                default_headers={"Accept-Encoding": "identity"},
            )  # fmt: skip
            client.organization = client.project = None  # it takes them from the environment
            self._clients[name] = client
        return self._clients[name]


def _read(content: bytes, endpoint: Endpoint, key: Key, *, asked: bool) -> Reply | ServerLost:
    """Return what a server sent as a reply; `asked`: it had to answer, a page may be missing."""
    try:
        answer = msgspec.json.decode(content)
        odd = "" if isinstance(answer, dict) else "object; is base_url right, up to /v1?"
    except (ValueError, RecursionError) as error:
        said = content[:_LONGEST_MESSAGE].decode(errors="replace")
        answer, odd = {}, f"({error}) but {said!r}"
    reason = f"the answer is no JSON {odd}" if odd else fault_in(answer) if asked else ""
    if reason:
        lost = _lost(endpoint, reason, key)
        return _BrokenReply(str(lost)) if asked else Reply(failure=_brief(reason, key))
    kept = key.out_of({name: one for name, one in answer.items() if name not in ("id", "created")})
    return Reply(answer=kept)


class _BrokenReply(ServerLost):
    """A body that says that the server could not answer; it is asked again."""


def _words(content: bytes) -> str:
    """Return what the body of a refusal says: its message in any of the usual places, or all."""
    text = content.decode(errors="replace").strip()
    try:
        said: Any = msgspec.json.decode(content)
    except (ValueError, RecursionError):
        return text
    for name in ("error", "detail", "message"):
        said = said.get(name) or said if isinstance(said, dict) else said
    return said if isinstance(said, str) else text


def fault_in(answer: Mapping[str, Any]) -> str:
    """Return what a body says of the server's own fault, in its words; "" for an answer.

    >>> fault_in({"error": {"message": "Rate limit exceeded", "code": 429}})
    'HTTP 200 with an error: Rate limit exceeded (429)'
    >>> fault_in({"choices": [{"text": "x", "finish_reason": "abort"}]})
    "it broke its answer off: finish_reason 'abort'"
    """
    error, choices, rows = (answer.get(name) for name in ("error", "choices", "data"))
    if error and not choices and not rows:
        parts = error if isinstance(error, dict) else {"message": error}
        code = parts.get("code")
        return f"HTTP 200 with an error: {parts.get('message')}" + (f" ({code})" if code else "")
    if isinstance(choices, list) and choices and isinstance(choices[0], dict):
        reason = choices[0].get("finish_reason")
        if reason is not None and str(reason) not in {*ENDS, *CUTS}:
            return f"it broke its answer off: finish_reason {reason!r}"
    for name, given in (("choices", choices), ("data", rows)):
        if name in answer and not given:
            return f"an answer without {name}"
    if isinstance(rows, list) and isinstance(rows[0], dict) and rows[0].get("embedding", 0) is None:
        return "an answer without numbers"
    return ""


def _lost(endpoint: Endpoint, reason: str, key: Key) -> ServerLost:
    """Return the error of a server that cannot answer now; the request is not recorded."""
    tried = f"asked {endpoint.retries + 1} times, {endpoint.timeout_s:g} s each at most"
    url = key.out_of(endpoint.base_url)
    if reason.startswith(("HTTP 401", "HTTP 403")):
        held = f"${endpoint.key_variable} holds" if key else f"export {endpoint.key_variable}=..."
        help_ = f"see what {held}; then the same command goes on" if key else held
    else:
        help_ = (
            f"see that a server answers at {url}, and that it can take so much at once"
            " (--workers, timeout_s, retries); then the same command goes on"
        )
    return ServerLost(
        f"{endpoint.model} at {endpoint.host}: {_brief(reason, key)} ({tried})\n  To fix: {help_}"
    )


def _brief(reason: str, key: Key) -> str:
    text: str = key.out_of(reason)
    return text if len(text) <= _LONGEST_MESSAGE else f"{text[:_LONGEST_MESSAGE]}..."


def _key(endpoint: Endpoint) -> Key:
    """Return the key of an endpoint; ModelError where its variable holds something else."""
    text = os.environ.get(endpoint.key_variable, "").strip()
    if text and not _KEY.fullmatch(text):
        raise ModelError(
            f"what ${endpoint.key_variable} holds is no key: letters, digits and signs, without"
            " spaces\n"
            f"  To fix: unset {endpoint.key_variable}, or name another variable as key_variable"
        )
    return Key(text)


def _openai() -> Any:
    try:
        import openai
    except ImportError as error:
        raise ModelError(
            f"hosted models need the package openai: {error}"
            "\n  To fix: pip install 'karma-offline[hosted]'"
        ) from error
    return openai


# ----------------------------------------------------------------- bounds


def _bounded(*, total_s: float, verify: bool) -> dict[str, Any]:
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
        self._until, self._left = monotonic() + self._total_s, LARGEST_ANSWER

    def wait(self, timeout_s: float | None) -> float:
        """Return how long the next step may take."""
        import httpcore2

        left = self._until - monotonic()
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
