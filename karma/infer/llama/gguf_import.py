"""Read a GGUF: what it says of itself, and its tokenizer as llama.cpp has it."""

from pathlib import Path
from typing import Any

from karma.errors import FileError
from karma.infer.llama.gguf_export import bare_tokenizer


def read_gguf_tokenizer(path: Path) -> Any:
    """Return the byte-level BPE `tokenizers.Tokenizer` of a GGUF; every token keeps its id.

    Raises:
        FileError: no such file, or no GGUF with such a tokenizer.
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
    tokenizer = bare_tokenizer(vocabulary, [_pair(merge) for merge in merges], pre)
    for text, kind in zip(tokens, kinds, strict=True):
        if kind in (gguf.TokenType.CONTROL, gguf.TokenType.USER_DEFINED):
            special = kind == gguf.TokenType.CONTROL
            tokenizer.add_tokens([AddedToken(text, normalized=False, special=special)])
    if any(tokenizer.token_to_id(text) != place for place, text in enumerate(tokens)):
        raise FileError(path, "its tokens are not in the order of gguf_export")
    return tokenizer


def _pair(merge: str) -> tuple[str, str]:
    left, _, right = merge.partition(" ")
    return left, right


def gguf_reader(path: Path) -> Any:
    """Return a `gguf.GGUFReader`.

    Raises:
        FileError: no such file, or no GGUF.
    """
    import gguf

    if not path.is_file():
        raise FileError(path, "no such file")
    try:
        return gguf.GGUFReader(path)
    except (ValueError, IndexError) as error:
        raise FileError(path, f"not a GGUF: {error}") from error
