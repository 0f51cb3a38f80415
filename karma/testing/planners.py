"""Make language models of random weights: any family's architecture, or a Llama of any size."""

from pathlib import Path
from typing import Any

from karma.infer.llama.gguf_export import add_special_tokens, add_vocabulary
from karma.testing.architectures import Size, language_keys, language_tensors
from karma.testing.families import Family, find_family
from karma.testing.random_gguf import add_keys, write_random_gguf
from karma.testing.vocabulary import make_tokenizer


def make_planner(
    path: str | Path, family: str = "llama3", seed: int = 0, *, size: Size | None = None
) -> Path:
    """Write a language model with the architecture, control tokens and template of a family.

    It babbles. By default it takes some 150 kB and a few hundredths of a second.

    Args:
        path: the GGUF file.
        family: a name of `FAMILIES`.
        seed: of the weights; same seed, same bytes.
        size: other than the smallest.

    Returns:
        The path.

    Raises:
        UnknownNameError: no such family.
        FileError: it cannot be written.
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
