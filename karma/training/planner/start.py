"""The weights and the tokenizer that training begins with: those of a GGUF, or new ones."""

from pathlib import Path
from typing import Any

from karma.infer.llama.gguf_import import fill_from_gguf, read_gguf_tokenizer
from karma.training.planner.network import new_model
from karma.training.planner.packs import WHOLE, PlannerRecipe


def extended_tokenizer(path: Path) -> Any:
    """Return a GGUF's tokenizer with what the notation has got since; every old id stays."""
    from tokenizers import AddedToken

    tokenizer = read_gguf_tokenizer(path)
    new = [text for text in WHOLE if tokenizer.token_to_id(text) is None]
    tokenizer.add_tokens([AddedToken(text, normalized=False, special=False) for text in new])
    return tokenizer


def started_model(recipe: PlannerRecipe, tokenizer: Any, path: Path) -> Any:
    """Return a GGUF's weights; a new token begins as the mean of the old ones that spelt it.

    Args:
        recipe: with the sizes of the GGUF, and the vocabulary's size of `tokenizer`.
        tokenizer: of `extended_tokenizer`.
        path: the GGUF.
    """
    import torch

    model = new_model(recipe)
    fill_from_gguf(model, path)
    old = read_gguf_tokenizer(path)
    table = model.model.embed_tokens.weight
    with torch.no_grad():
        for token in range(old.get_vocab_size(), tokenizer.get_vocab_size()):
            text = tokenizer.decode([token], skip_special_tokens=False)
            table[token] = table[old.encode(text, add_special_tokens=False).ids].mean(0)
    return model
