"""GGUFs read back: the tokens are llama.cpp's, and what is none is refused."""

from pathlib import Path

import pytest
from support.paths import ROOT

from karma.errors import FileError
from karma.infer.llama.gguf_export import new_tokenizer
from karma.infer.llama.gguf_import import read_gguf_tokenizer

SHIPPED = ROOT / "models" / "nano" / "planner.gguf"
CORPUS = ["PutObject(robot, 'Apple', 'Fridge')\nPlease warm the bread; it's 1234.\n"] * 3


@pytest.fixture
def tokenizer():
    from tokenizers import AddedToken

    made = new_tokenizer(CORPUS, 320, ["<|eos|>", "<|pad|>"])
    made.add_tokens([AddedToken("', '", normalized=False, special=False)])
    return made


def test_tokens_of_the_shipped_planner_are_read_as_llama_cpp_has_them():
    import llama_cpp

    tokenizer = read_gguf_tokenizer(SHIPPED)
    model = llama_cpp.Llama(str(SHIPPED), vocab_only=True, verbose=False)
    for text in ("#task put a mug\n", "PutObject(robot, 'Mug', 'Sink')\n", "Überraschung 42  x"):
        ids = tokenizer.encode(text, add_special_tokens=False).ids
        assert ids == model.tokenize(text.encode(), add_bos=False, special=True)


def test_what_is_no_fitting_gguf_is_refused_by_name(tmp_path, tokenizer):
    with pytest.raises(FileError, match="no such file"):
        read_gguf_tokenizer(tmp_path / "none.gguf")
    torn = Path(tmp_path / "torn.gguf")
    torn.write_bytes(b"GGUF torn")
    with pytest.raises(FileError, match=r"torn\.gguf: not a GGUF"):
        read_gguf_tokenizer(torn)
