"""Train the small byte-level tokenizer that every made model has: skills, things, its own tags."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from karma.agent.program import SKILLS
from karma.infer.llama.gguf_export import new_tokenizer
from karma.testing.families import Family

TRAINED = 640  # tokens, the family's own among them
_THINGS = ("Apple", "Bread", "Mug", "Plate", "Knife", "Egg", "Fridge", "Microwave", "CounterTop")


@lru_cache(maxsize=32)
def make_tokenizer(family: Family) -> Any:
    """Return a `tokenizers.Tokenizer` whose ids begin with the family's control tokens."""
    from tokenizers import AddedToken

    tokenizer = new_tokenizer(_texts(), TRAINED - len(family.added), family.control)
    tokenizer.add_tokens([AddedToken(text, special=False) for text in family.added])
    return tokenizer


def _texts() -> Iterable[str]:
    for skill in SKILLS:
        yield from (f"{skill.name}(robot, '{thing}')\n" for thing in _THINGS)
        yield f"{skill.name}: {skill.doc}\n"
    yield from (f"Explore(robot, '{thing}', ['node_1', 'node_2'])\n" for thing in _THINGS)
