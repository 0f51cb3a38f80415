"""Count what hosted models cost: the endpoint's tokens, money by the user's price table."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec

_MILLION = 1e6
_ADDED = ("requests", "failures", "prompt_tokens", "completion_tokens", "cost", "seconds")


class Prices(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a million tokens cost, in one currency of the user's choice."""

    input: float
    output: float = 0.0
    cached_input: float | None = None  # None: as `input`


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
