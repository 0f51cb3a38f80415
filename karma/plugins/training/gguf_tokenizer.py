"""Read the tokenizer of a GGUF, so that examples are cut as llama.cpp cuts prompts."""

from pathlib import Path
from typing import Any

from karma.errors import FileError
from karma.models.llama.gguf_files import bare_tokenizer, gguf_reader


def read_gguf_tokenizer(path: Path) -> Any:
    """Return the byte-level BPE `tokenizers.Tokenizer` of a GGUF; every token keeps its id.

    FileError where there is no such file, or no GGUF with such a tokenizer.
    """
    import gguf
    from tokenizers import AddedToken

    fields = gguf_reader(path).fields
    try:
        tokens, kinds, merges, pre = (
            fields[f"tokenizer.ggml.{name}"].contents()
            for name in ("tokens", "token_type", "merges", "pre")
        )
    except KeyError as error:
        raise FileError(path, f"no {error.args[0]} in it") from error
    vocabulary = {text: place for place, text in enumerate(tokens)}
    pairs = [merge.partition(" ")[::2] for merge in merges]
    tokenizer = bare_tokenizer(vocabulary, pairs, pre)
    for text, kind in zip(tokens, kinds, strict=True):
        if kind in (gguf.TokenType.CONTROL, gguf.TokenType.USER_DEFINED):
            special = kind == gguf.TokenType.CONTROL
            tokenizer.add_tokens([AddedToken(text, normalized=False, special=special)])
    if any(tokenizer.token_to_id(text) != place for place, text in enumerate(tokens)):
        raise FileError(path, "its tokens are not in the order of its ids")
    return tokenizer
