"""Count the tokens of an exchange, and their cost by a price table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from karma.models.endpoint import Prices

_MILLION = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """Tokens of one exchange; None where the endpoint does not say."""

    prompt_tokens: int | None = None
    cached_tokens: int | None = None  # of the prompt, taken from the endpoint's cache
    completion_tokens: int | None = None


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
