"""Make language models of random weights: any family's architecture, or a Llama of any size."""

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from karma.agent.planning.prompt import render, skills_of
from karma.contracts import PlanRequest
from karma.household.types import object_types
from karma.infer.llama.gguf_files import add_special_tokens, add_vocabulary, new_tokenizer
from karma.train.testing.families import Family, Size, find_family, language_keys, language_tensors
from karma.train.testing.random_gguf import add_keys, write_random_gguf

TRAINED = 1200  # tokens, the family's own among them


def make_planner(
    path: str | Path, family: str = "llama3", seed: int = 0, *, size: Size | None = None
) -> Path:
    """Write a language model with the architecture, control tokens and template of a family.

    It babbles. By default it takes some 150 kB and a few hundredths of a second.

    Same seed, same bytes. UnknownNameError if no such family; FileError if it cannot be
    written.
    """
    chosen, size = find_family(family), size or Size()

    def fill(writer: Any) -> None:
        writer.add_name(f"random {family}")
        writer.add_description("Random weights: for tests and measurements of speed")
        add_keys(writer, language_keys(chosen.architecture, size))
        _add_words(writer, chosen, size.vocabulary)

    tensors = language_tensors(chosen.architecture, size)
    return write_random_gguf(path, chosen.architecture, fill, tensors, seed=seed)


def make_llama(
    path: str | Path,
    *,
    layers: int,
    width: int,
    heads: int,
    kv_heads: int,
    feed_forward: int,
    vocabulary: int,
    seed: int = 0,
    context: int = 8192,
    tied: bool = True,
) -> Path:
    """Write a Llama of random F16 weights in the size of a real one, to measure speed and memory.

    Its first tokens are those of `make_planner`, the rest of the vocabulary is never said. Weights
    go to the disk matrix by matrix: a model of 3 B takes 6 GB there, half a minute, and 2 GB of
    memory at most. `tied`: the embedding is the output too, as in most models below 4 B.
    """
    size = Size(
        layers=layers, width=width, heads=heads, kv_heads=kv_heads, feed_forward=feed_forward,
        vocabulary=vocabulary, context=context, tied=tied,
    )  # fmt: skip
    return make_planner(path, "llama3", seed, size=size)


def _add_words(writer: Any, family: Family, vocabulary: int) -> None:
    tokenizer = make_tokenizer(family, vocabulary)
    add_vocabulary(writer, tokenizer, vocabulary, pre=family.pre)
    ends = {"bos": family.bos, "eos": family.eos}
    add_special_tokens(writer, tokenizer, ends, add_bos=family.add_bos)
    writer.add_chat_template(family.template)


@lru_cache(maxsize=32)
def make_tokenizer(family: Family, vocabulary: int = TRAINED) -> Any:
    """Return a `tokenizers.Tokenizer` whose ids begin with the family's control tokens.

    It has no more tokens than the model's vocabulary, and no more than `TRAINED`.
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
