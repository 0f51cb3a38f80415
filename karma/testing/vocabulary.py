"""Train the small byte-level tokenizer that every made model has: skills, things, its own tags."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from karma.agent.prompt import render, skills_of
from karma.contracts import PlanRequest
from karma.household.types import object_types
from karma.infer.llama.gguf_export import new_tokenizer
from karma.testing.families import Family

TRAINED = 1200  # tokens, the family's own among them


@lru_cache(maxsize=32)
def make_tokenizer(family: Family, vocabulary: int = TRAINED) -> Any:
    """Return a `tokenizers.Tokenizer` whose ids begin with the family's control tokens.

    Args:
        family: whose control tokens.
        vocabulary: of the model; the tokenizer has no more tokens, and no more than `TRAINED`.
    """
    from tokenizers import AddedToken

    tokenizer = new_tokenizer(
        _texts(), min(vocabulary, TRAINED) - len(family.added), family.control
    )
    tokenizer.add_tokens([AddedToken(text, special=False) for text in family.added])
    return tokenizer


def _texts() -> Iterable[str]:
    """Yield what planners read and write, so that a prompt takes few tokens."""
    request = PlanRequest(instruction="put the apple in the fridge")
    yield render("full", request).prompt.stable
    yield from ["\n\n"] * 50  # a token: llama.cpp puts it before pictures of Idefics 3
    for thing in object_types():
        yield from (f"{skill.name}(robot, '{thing}')\n" for skill in skills_of("full"))
        yield f"Explore(robot, '{thing}', ['node_1', 'node_2'])\n"
