"""GGUF files: llama.cpp sees the same tokens and computes the same logits; tokens are read back."""

from unicodedata import ucd_3_2_0

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.llama_export import export_llama, random_llama
from support.paths import ROOT

from karma.models.llama.gguf_files import new_tokenizer

SHIPPED = ROOT / "models" / "nano" / "planner.gguf"
CORPUS = [
    "PutObject(robot, 'Apple', 'Fridge')\nGoToObject(robot, 'Apple|-00.47|+01.15|+00.48')\n",
    "Please warm the bread, then put 2 plates on the dining table. It's 1234 o'clock; we're OK.\n",
    "Überraschung: ça va? 你好 世界 — наконец-то!   \n\n\tindent  done\r\n",
] * 3


@pytest.fixture(scope="module")
def tokenizer():
    return new_tokenizer(CORPUS, 400, ["<|pad|>", "<|bos|>", "<|eos|>"])


def loaded(path, **options):
    import llama_cpp

    f32 = {"type_k": llama_cpp.GGML_TYPE_F32, "type_v": llama_cpp.GGML_TYPE_F32}
    return llama_cpp.Llama(
        str(path), n_ctx=256, n_threads=1, verbose=False, **({"logits_all": True} | f32 | options)
    )


@pytest.fixture(scope="module")
def vocabulary(tokenizer, tmp_path_factory):
    path = tmp_path_factory.mktemp("gguf") / "tiny.gguf"
    return loaded(export_llama(random_llama(420), tokenizer, path), logits_all=False)


@pytest.mark.parametrize(("tied", "dtype", "tolerance"), [
    (True, "F32", 1e-3), (False, "F32", 1e-3), (True, "F16", 0.1), (True, "BF16", 0.5),
    (True, "Q8_0", 1.0),
])  # fmt: skip
def test_export_random_llama_gives_transformers_logits(tmp_path, tokenizer, tied, dtype, tolerance):
    import torch

    model = random_llama(420, tie_word_embeddings=tied)
    path = export_llama(model, tokenizer, tmp_path / "tiny.gguf", dtype=dtype)
    tokens = np.random.default_rng(1).integers(3, 400, 100).tolist()
    with torch.no_grad():
        expected = model(torch.tensor([tokens])).logits[0].numpy()
    llama = loaded(path)
    llama.eval(tokens)
    found = llama.scores[: len(tokens)]
    assert expected.std() > 1
    assert np.abs(found - expected).max() < tolerance


# Characters on whose class the two libraries' Unicode tables agree: assigned long ago.
TEXTS = st.text(
    st.one_of(
        st.characters(min_codepoint=32, max_codepoint=126),
        st.sampled_from("\n\r\t '\"|_-[](),."),
        st.characters(
            min_codepoint=0xA0, max_codepoint=0x1FFFF, categories=["L", "P", "Nd", "Zs", "Sc"],
            codec="utf-8",
        ).filter(lambda c: ucd_3_2_0.category(c) != "Cn"),
    )
)  # fmt: skip


@given(text=TEXTS)
def test_tokens_any_text_equal_in_both_libraries(tokenizer, vocabulary, text):
    ids = tokenizer.encode(text, add_special_tokens=False).ids
    assert vocabulary.tokenize(text.encode(), add_bos=False, special=True) == ids
    assert tokenizer.decode(ids, skip_special_tokens=False) == text


def test_export_tells_llama_cpp_the_special_tokens(tmp_path, tokenizer):
    path = export_llama(
        random_llama(420), tokenizer, tmp_path / "tiny.gguf", bos="<|bos|>", pad="<|pad|>",
        add_bos=True, template="{{ messages }}", licence="Apache-2.0",
    )  # fmt: skip
    llama = loaded(path)
    assert (llama.token_bos(), llama.token_eos()) == (1, 2)
    assert llama.tokenize(b"a")[0] == 1
    assert llama.metadata["tokenizer.chat_template"] == "{{ messages }}"
    assert llama.metadata["general.license"] == "Apache-2.0"
