"""Describe hosted models: where they are, which variable holds their key, and what they cost."""

from typing import Any, Literal, Self
from urllib.parse import urlsplit

import msgspec

from karma.errors import KarmaError

DialectName = Literal["auto", "llama-server", "vllm", "sglang", "ollama", "plain"]
Constraint = Literal["grammar", "schema"]
_ASKED_AT = ("/chat/completions", "/completions", "/embeddings", "/models")  # not the base
_OURS = frozenset({"input", "messages", "model", "n", "prompt", "stream"})


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
