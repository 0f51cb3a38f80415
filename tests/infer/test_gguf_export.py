"""Exported models: llama.cpp must see the same tokens and compute the same logits."""

from unicodedata import ucd_3_2_0

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.llama_export import export_llama_gguf

from karma.errors import FileError, ModelError
from karma.infer.llama.gguf_files import new_tokenizer

CORPUS = [
    "PutObject(robot, 'Apple', 'Fridge')\nGoToObject(robot, 'Apple|-00.47|+01.15|+00.48')\n",
    "Please warm the bread, then put 2 plates on the dining table. It's 1234 o'clock; we're OK.\n",
    "Überraschung: ça va? 你好 世界 — наконец-то!   \n\n\tindent  done\r\n",
] * 3


def random_llama(vocab_size, *, tied=True, kv_heads=2):
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    torch.manual_seed(7)
    config = LlamaConfig(
        vocab_size=vocab_size, hidden_size=64, intermediate_size=160, num_hidden_layers=2,
        num_attention_heads=4, num_key_value_heads=kv_heads, max_position_embeddings=256,
        tie_word_embeddings=tied, initializer_range=0.2,
    )  # fmt: skip
    return LlamaForCausalLM(config).eval()


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
    export_llama_gguf(random_llama(420), tokenizer, path, name="tiny", eos_token="<|eos|>")
    return loaded(path, logits_all=False)


@pytest.mark.parametrize(("tied", "dtype", "tolerance"), [
    (True, "F32", 1e-3), (False, "F32", 1e-3), (True, "F16", 0.1), (True, "BF16", 0.5),
    (True, "Q8_0", 1.0),
])  # fmt: skip
def test_export_random_llama_gives_transformers_logits(tmp_path, tokenizer, tied, dtype, tolerance):
    import torch

    model = random_llama(420, tied=tied)
    path = tmp_path / "tiny.gguf"
    export_llama_gguf(model, tokenizer, path, name="tiny", eos_token="<|eos|>", dtype=dtype)
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


WORDS = ["PutObject", "Apple", "'s", "'LL", "12", "1234", "..", "|", "|-00.47", "é"]


@given(text=st.lists(st.sampled_from([*WORDS, " ", "  ", "\n", " \n ", "\t", "\r\n"])).map("".join))
def test_tokens_of_program_like_text_equal_in_both_libraries(tokenizer, vocabulary, text):
    ids = tokenizer.encode(text, add_special_tokens=False).ids
    assert vocabulary.tokenize(text.encode(), add_bos=False, special=False) == ids


def test_export_tells_llama_cpp_the_special_tokens(tmp_path, tokenizer):
    path = tmp_path / "tiny.gguf"
    export_llama_gguf(
        random_llama(420), tokenizer, path, name="tiny", eos_token="<|eos|>", bos_token="<|bos|>",
        pad_token="<|pad|>", add_bos=True, chat_template="{{ messages }}", licence="Apache-2.0",
    )  # fmt: skip
    llama = loaded(path)
    assert (llama.token_bos(), llama.token_eos()) == (1, 2)
    assert llama.tokenize(b"a")[0] == 1
    assert llama.metadata["tokenizer.chat_template"] == "{{ messages }}"
    assert llama.metadata["general.license"] == "Apache-2.0"


def test_export_state_dict_with_config_equals_model(tmp_path, tokenizer):
    model = random_llama(420)
    for name, weights, config in (("a", model, None), ("b", model.state_dict(), model.config)):
        export_llama_gguf(
            weights, tokenizer, tmp_path / name, name="x", eos_token="<|eos|>", config=config
        )
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_export_what_the_format_would_lose_is_refused(tmp_path, tokenizer):
    from tokenizers import Tokenizer, models

    model, path = random_llama(420), tmp_path / "x.gguf"
    with pytest.raises(ModelError, match="nope"):
        export_llama_gguf(model, tokenizer, path, name="x", eos_token="nope")
    with pytest.raises(ModelError, match="llama-bpe"):
        export_llama_gguf(model, Tokenizer(models.BPE()), path, name="x", eos_token="<|eos|>")
    with pytest.raises(ModelError, match="only 300"):
        export_llama_gguf(random_llama(300), tokenizer, path, name="x", eos_token="<|eos|>")
    state = model.state_dict() | {"model.extra.weight": model.lm_head.weight}
    with pytest.raises(ModelError, match="extra"):
        export_llama_gguf(
            state, tokenizer, path, name="x", eos_token="<|eos|>", config=model.config
        )
    assert list(tmp_path.iterdir()) == []


def test_export_into_unwritable_place_is_file_error(tmp_path, tokenizer):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError):
        export_llama_gguf(
            random_llama(420), tokenizer, tmp_path / "file" / "x.gguf", name="x",
            eos_token="<|eos|>",
        )  # fmt: skip
