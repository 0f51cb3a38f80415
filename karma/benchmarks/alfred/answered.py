"""What a record keeps of a planner's answer, whatever was asked for."""

from dataclasses import dataclass
from typing import Any

from karma.contracts import Completion

KEPT = 20_000  # characters of an answer that a record keeps


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkAnswer:
    """One planner call."""

    text: str  # the first 20,000 characters
    characters: int  # of the whole
    prompt_tokens: int | None
    completion_tokens: int | None
    finish: str = ""
    cost: float | None = None


def kept(said: Completion) -> dict[str, Any]:
    """Return what is kept of an answer."""
    return {
        "text": said.text[:KEPT],
        "characters": len(said.text),
        "prompt_tokens": said.prompt_tokens,
        "completion_tokens": said.completion_tokens,
        "finish": said.finish,
        "cost": said.cost,
    }
