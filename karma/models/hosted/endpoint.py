"""Say where hosted models are, what keeps their keys, and what they cost by a price table.

A key stands in one header, and nowhere else. What comes back is searched for it, as it is and in
the disguises that a server could give it: reversed, in base64, base32 or hexadecimal,
percent-encoded, as HTML, rotated by 13, in other case, or cut in pieces. Not found: what needs the
server's own secret to be read, such as encryption.
"""

import base64
import codecs
import html
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, Self
from urllib.parse import urlsplit

import msgspec

from karma.errors import KarmaError

DialectName = Literal["auto", "llama-server", "vllm", "sglang", "ollama", "transformers", "plain"]
Constraint = Literal["grammar", "regex", "schema"]
_ASKED_AT = ("/chat/completions", "/completions", "/embeddings", "/models")  # not the base
_OURS = frozenset({"input", "messages", "model", "n", "prompt", "stream"})
_MILLION = 1e6
_ADDED = ("requests", "failures", "prompt_tokens", "completion_tokens", "cost", "seconds")


class Prices(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a million tokens cost, in one currency of the user's choice."""

    input: float
    output: float = 0.0
    cached_input: float | None = None  # None: as `input`


class Endpoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One hosted model, as an experiment file gives it."""

    base_url: str  # up to and with "/v1"
    model: str
    key_variable: str = "OPENAI_API_KEY"  # the environment variable that holds the key
    api: Literal["chat", "completions"] = "chat"  # "completions" for models without a chat template
    timeout_s: float = 120.0
    retries: int = 2  # of refused connections, timeouts, 429 and 5xx, with growing pauses
    prices: Prices | None = None
    tokens_field: Literal["max_tokens", "max_completion_tokens"] = "max_tokens"
    omit: tuple[str, ...] = ()  # fields that the endpoint refuses, e.g. "temperature", "seed"
    extra: dict[str, Any] = {}  # fields to add
    dialect: DialectName = "auto"  # whose server it is; "auto" asks it
    constraint: Constraint | None = None  # how programs are asked for; None: the dialect's way

    def __post_init__(self) -> None:
        """Refuse what could not work, or would put a key where it does not belong."""
        base = self.base_url.strip().rstrip("/")
        for end in _ASKED_AT:
            base = base.removesuffix(end)
        if base != self.base_url.rstrip("/"):
            msgspec.structs.force_setattr(self, "base_url", base)
        parts = urlsplit(self.base_url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("base_url is no http(s) address such as http://127.0.0.1:8000/v1")
        _ = parts.port  # raises ValueError where it is no port
        if parts.username or parts.password or parts.query or parts.fragment:
            raise ValueError("base_url holds more than a place: keys belong into the environment")
        if not self.model:
            raise ValueError("model is empty")
        if self.timeout_s <= 0 or self.retries < 0:
            raise ValueError("timeout_s is more than 0, and retries 0 or more")
        if taken := sorted(_OURS & set(self.extra)):
            raise ValueError(f"extra: {taken[0]!r} is set by karma itself")

    def at(self, base_url: str) -> "Endpoint":
        """Return the same model at another place; KarmaError where the address cannot be used."""
        try:
            return msgspec.structs.replace(self, base_url=base_url)
        except ValueError as error:
            raise KarmaError(str(error)) from error

    @property
    def host(self) -> str:
        """Name or address, without scheme and port."""
        return urlsplit(self.base_url).hostname or ""

    @property
    def root(self) -> str:
        """Address of the server's own pages, which lie beside /v1."""
        return self.base_url.rstrip("/").removesuffix("/v1")


class Hosted(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the roles are that hosted models fill."""

    planner: Endpoint | None = None
    vision: Endpoint | None = None
    embedder: Endpoint | None = None

    @classmethod
    def of_planner(cls, base_url: str, model: str, **settings: str) -> Self:
        """Return a hosted planner alone, of fields of `Endpoint`; KarmaError for a wrong one."""
        try:
            return msgspec.convert(
                {"planner": {"base_url": base_url, "model": model, **settings}}, cls
            )
        except msgspec.ValidationError as error:
            raise KarmaError(f"the hosted planner: {error}") from error

    def at(self, base_url: str) -> "Hosted":
        """Return the same models at another place.

        KarmaError where the address cannot be used, or there is no hosted model.
        """
        moved = {
            role: endpoint.at(base_url)
            for role in self.__struct_fields__
            if (endpoint := getattr(self, role)) is not None
        }
        if not moved:
            raise KarmaError("--base-url is given, but no role has a hosted model")
        return Hosted(**moved)


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """Tokens of one exchange; None where the endpoint does not say."""

    prompt_tokens: int | None = None
    cached_tokens: int | None = None  # of the prompt, taken from the endpoint's cache
    completion_tokens: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What one hosted model cost over some time; None where it is not known."""

    role: str  # planner, vision, embedder
    model: str  # as the endpoint names it
    requests: int
    failures: int  # of them, without an answer
    prompt_tokens: int | None
    completion_tokens: int | None
    cost: float | None  # in the currency of the price table; None without one
    seconds: float | None  # waited, retries included; a replay repeats what was measured


def usage_of(answer: Mapping[str, Any]) -> Usage:
    """Return the tokens that an answer says it took."""
    usage = answer.get("usage")
    if not isinstance(usage, dict):
        return Usage()
    details = usage.get("prompt_tokens_details")
    return Usage(
        prompt_tokens=_count(usage.get("prompt_tokens")),
        cached_tokens=_count(details.get("cached_tokens")) if isinstance(details, dict) else None,
        completion_tokens=_count(usage.get("completion_tokens", 0)),  # embeddings have none
    )


def _count(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def cost_of(usage: Usage, prices: Prices | None) -> float | None:
    """Return what an exchange cost; None without prices or without token counts.

    >>> cost_of(Usage(prompt_tokens=1000, completion_tokens=500), Prices(input=2.0, output=8.0))
    0.006
    """
    if prices is None or usage.prompt_tokens is None or usage.completion_tokens is None:
        return None
    cached = usage.cached_tokens or 0
    price = prices.input if prices.cached_input is None else prices.cached_input
    fresh = (usage.prompt_tokens - cached) * prices.input
    return (fresh + cached * price + usage.completion_tokens * prices.output) / _MILLION


def total(parts: Iterable[float | None]) -> float | None:
    """Return a sum; None when there is nothing to add or one part is not known."""
    known = list(parts)
    return sum(p for p in known if p is not None) if known and None not in known else None


class Ledger:
    """Adds up what the hosted models of a run cost."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, str], Spent] = {}

    def enter(self, new: Spent) -> None:
        """Enter one exchange, or what was added up elsewhere."""
        if old := self._open.get((new.role, new.model)):
            sums: Any = {name: total([getattr(old, name), getattr(new, name)]) for name in _ADDED}
            new = replace(old, **sums)
        self._open[new.role, new.model] = new

    def take(self) -> tuple[Spent, ...]:
        """Return what was spent since the last time, by role and model."""
        found = tuple(self._open[key] for key in sorted(self._open))
        self._open.clear()
        return found


# ----------------------------------------------------------------- keys


HIDDEN = "[key]"  # what stands where a key was
_SHORTEST = 8  # characters; anything shorter is a word such as EMPTY, found in innocent text
_SURE = 16  # letters and digits; shorter ones are not looked for across signs and spaces
_SIGNS = re.compile(r"[^a-z0-9]+")


class Key:
    """A key that shows itself to nobody who prints it, not even as a local variable.

    "" is none, as servers on this machine mostly want; a short one is no secret.
    """

    def __init__(self, text: str = "") -> None:
        self._text = text
        self._hidden = text if len(text) >= _SHORTEST else ""

    def __bool__(self) -> bool:
        return bool(self._text)

    def __repr__(self) -> str:
        return f"Key({HIDDEN!r})" if self._text else "Key()"

    def for_header(self) -> str:
        """Return the key itself."""
        return self._text or "none"

    def out_of(self, value: Any) -> Any:
        """Return a JSON value without the key, wherever in it that stood."""
        if not self._hidden:
            return value
        match value:
            case str():
                return value.replace(self._hidden, HIDDEN)
            case dict():
                return {self.out_of(name): self.out_of(one) for name, one in value.items()}
            case list() | tuple():
                return [self.out_of(one) for one in value]
            case _:
                return value

    def is_disguised_in(self, value: Any) -> bool:
        """Return whether a JSON value holds the key in another form, or in pieces."""
        if not self._hidden:
            return False
        texts = list(_texts(value))
        if any(form in text for text in texts for form in self._exact):
            return True
        if not self._squeezed:
            return False
        whole = "".join((*texts, "\n", *_texts(value, names=False)))  # with names between, without
        for _ in range(2 if "&" in whole else 0):  # twice over, also
            whole = html.unescape(whole)
        squeezed = _squeeze(whole)
        return any(form in squeezed for form in self._squeezed)

    @cached_property
    def _exact(self) -> tuple[str, ...]:
        """Forms that are looked for letter by letter."""
        data = self._text.encode()
        return (self._text[::-1], data.hex(), data.hex().upper(), *_base64(data))

    @cached_property
    def _squeezed(self) -> tuple[str, ...]:
        """Forms that are looked for among letters and digits alone, in any case."""
        if len(_squeeze(self._text)) < _SURE:
            return ()
        plain = (self._text, self._text[::-1], codecs.encode(self._text, "rot13"))
        coded = (base64.b32encode(self._text.encode()).decode().rstrip("="), *self._exact[1:])
        return tuple(map(_squeeze, (*plain, *coded)))


def _base64(data: bytes) -> Iterator[str]:
    """Yield what stays of bytes in base64, wherever in a longer text they began."""
    for before in range(3):
        first = -(-before * 8 // 6)  # letters that hold bits of what came before
        coded = base64.b64encode(bytes(before) + data).decode()
        whole = coded[first : (before + len(data)) * 8 // 6]
        yield whole
        yield whole.replace("+", "-").replace("/", "_")


def _squeeze(text: str) -> str:
    return _SIGNS.sub("", text.lower())


def _texts(value: Any, *, names: bool = True) -> Iterator[str]:
    """Yield all texts of a JSON value in order, with the names in it or without."""
    match value:
        case str():
            yield value
        case dict():
            for name, one in value.items():
                if names:
                    yield name
                yield from _texts(one, names=names)
        case list() | tuple():
            for one in value:
                yield from _texts(one, names=names)
