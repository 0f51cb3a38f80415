"""GGUF files as llama.cpp has them: their tokenizer, what they say of themselves, a new one.

llama.cpp loads a file with a wrong tokenizer name or unpermuted attention rows without a word and
then computes something else, so this is checked by comparing tokens and logits
(`tests/infer/test_gguf_export.py`).
"""

import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.errors import FileError, ModelError
from karma.files import write_atomic

# The expression llama.cpp uses for tokenizer.ggml.pre = "llama-bpe"; letter case is spelled out
# because "(?i:...)" would also admit letters that fold to these.
LLAMA_BPE_REGEX = (
    r"(?:'[sS]|'[tT]|'[rR][eE]|'[vV][eE]|'[mM]|'[lL][lL]|'[dD])"
    r"|[^\r\n\p{L}\p{N}]?\p{L}+|\p{N}{1,3}| ?[^\s\p{L}\p{N}]+[\r\n]*|\s*[\r\n]+|\s+(?!\S)|\s+"
)

SPLITS = {
    "llama-bpe": LLAMA_BPE_REGEX,
    "qwen2": LLAMA_BPE_REGEX.replace("{1,3}", ""),  # each digit for itself
    "smollm": "",  # digits for themselves, then as GPT-2 does
}


def new_tokenizer(corpus: Iterable[str], vocab_size: int, special_tokens: Sequence[str]) -> Any:
    """Train a byte-level BPE `tokenizers.Tokenizer` that llama.cpp reproduces token for token.

    At most `vocab_size` tokens, special ones included, which get the first ids in their order; 256
    are single bytes, so every text can be encoded.
    """
    from tokenizers import pre_tokenizers, trainers

    tokenizer = bare_tokenizer()
    trainer = trainers.BpeTrainer(
        vocab_size=vocab_size, special_tokens=list(special_tokens), show_progress=False,
        initial_alphabet=sorted(pre_tokenizers.ByteLevel.alphabet()),
    )  # fmt: skip
    tokenizer.train_from_iterator(corpus, trainer)
    tokenizer.model.ignore_merges = True  # as llama.cpp does for "llama-bpe"
    return tokenizer


def bare_tokenizer(
    vocabulary: Mapping[str, int] | None = None,
    merges: Sequence[tuple[str, str]] = (),
    pre: str = "llama-bpe",
) -> Any:
    """Return a `tokenizers.Tokenizer` of these pieces that splits and joins as llama.cpp does.

    ModelError where `pre`, llama.cpp's name for how a text is split, is none of `SPLITS`.
    """
    from tokenizers import Regex, Tokenizer, decoders, models, pre_tokenizers

    if pre not in SPLITS:
        raise ModelError(f"texts are split in the way {pre!r}; known are: {', '.join(SPLITS)}")
    known: dict[str, Any] = {}
    if vocabulary is not None:
        known = {"vocab": dict(vocabulary), "merges": list(merges)}
    tokenizer = Tokenizer(models.BPE(**known, ignore_merges=pre == "llama-bpe"))
    first: Any = pre_tokenizers.Digits(individual_digits=True)
    if pre != "smollm":
        first = pre_tokenizers.Split(Regex(SPLITS[pre]), behavior="isolated")
    then = pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=pre == "smollm")
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence([first, then])
    tokenizer.decoder = decoders.ByteLevel()
    return tokenizer


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


def gguf_reader(path: Path) -> Any:
    """Return a `gguf.GGUFReader`; FileError where there is no such file, or no GGUF."""
    import gguf

    if not path.is_file():
        raise FileError(path, "no such file")
    try:
        return gguf.GGUFReader(path)
    except (ValueError, IndexError) as error:
        raise FileError(path, f"not a GGUF: {error}") from error


def add_vocabulary(writer: Any, tokenizer: Any, vocab_size: int, *, pre: str = "llama-bpe") -> None:
    """Write tokens in id order, their types, and the merges in rank order.

    Ids below `vocab_size` that the tokenizer (of `new_tokenizer`) lacks are never said. `pre` is
    how llama.cpp splits a text; only with the default are its tokens the tokenizer's.
    """
    import gguf

    tokens = [f"[unused{i}]" for i in range(vocab_size)]
    types = [int(gguf.TokenType.UNUSED)] * vocab_size
    for text, token in tokenizer.get_vocab(with_added_tokens=False).items():
        tokens[token], types[token] = text, int(gguf.TokenType.NORMAL)
    for token, added in tokenizer.get_added_tokens_decoder().items():
        kind = gguf.TokenType.CONTROL if added.special else gguf.TokenType.USER_DEFINED
        tokens[token], types[token] = added.content, int(kind)
    merges = json.loads(tokenizer.to_str())["model"]["merges"]
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre(pre)
    writer.add_token_list(tokens)
    writer.add_token_types(types)
    writer.add_token_merges([m if isinstance(m, str) else " ".join(m) for m in merges])


def add_special_tokens(
    writer: Any, tokenizer: Any, specials: Mapping[str, str | None], *, add_bos: bool
) -> None:
    """Write the ids of the tokens "bos", "eos" and "pad", where there are such.

    ModelError where one is not in the vocabulary, or `add_bos` without a "bos".
    """
    add = {
        "bos": writer.add_bos_token_id,
        "eos": writer.add_eos_token_id,
        "pad": writer.add_pad_token_id,
    }
    for use, text in specials.items():
        if text is None:
            continue
        token = tokenizer.token_to_id(text)
        if token is None:
            raise ModelError(f"the {use} token {text!r} is not in the tokenizer's vocabulary")
        add[use](token)
    if add_bos and specials["bos"] is None:
        raise ModelError("add_bos needs a bos_token")
    writer.add_add_bos_token(add_bos)
    writer.add_add_eos_token(False)


def interleave(array: NDArray[np.float32], heads: int) -> NDArray[np.float32]:
    """Reorder rotary rows from transformers' half-split to llama.cpp's interleaved pairs."""
    rows, columns = array.shape
    halves = array.reshape(heads, 2, rows // heads // 2, columns)
    return np.ascontiguousarray(halves.swapaxes(1, 2).reshape(rows, columns))


def write_gguf(path: Path, fill: Any, architecture: str = "llama") -> None:
    """Let `fill` build the file elsewhere, then put it in its place."""
    import gguf

    try:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / "made.gguf"
            writer = gguf.GGUFWriter(made, architecture)
            fill(writer)
            writer.write_header_to_file()
            writer.write_kv_data_to_file()
            writer.write_tensors_to_file()
            writer.close()
            write_atomic(path, made.read_bytes())
    except OSError as error:
        fix = "free some space there, or set TMPDIR to another folder"
        raise FileError(path, f"cannot write: {error.strerror or error}", fix=fix) from error
