"""GGUFs read back: equal bytes when they are written again, and equal tokens."""

from pathlib import Path

import pytest
from support.paths import ROOT

from karma.errors import FileError, ModelError
from karma.infer.llama.gguf_export import export_llama_gguf, new_tokenizer
from karma.infer.llama.gguf_import import fill_from_gguf, read_gguf_tokenizer

SHIPPED = ROOT / "models" / "nano" / "planner.gguf"
CORPUS = ["PutObject(robot, 'Apple', 'Fridge')\nPlease warm the bread; it's 1234.\n"] * 3


def random_llama(vocab_size, *, kv_heads=2, seed=7):
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    torch.manual_seed(seed)
    config = LlamaConfig(
        vocab_size=vocab_size, hidden_size=64, intermediate_size=160, num_hidden_layers=2,
        num_attention_heads=4, num_key_value_heads=kv_heads, max_position_embeddings=256,
        tie_word_embeddings=True, initializer_range=0.2,
    )  # fmt: skip
    return LlamaForCausalLM(config).eval()


def written(tmp_path, model, tokenizer, name="one", dtype="F32"):
    path = tmp_path / f"{name}.gguf"
    export_llama_gguf(model, tokenizer, path, name="tiny", eos_token="<|eos|>", dtype=dtype)
    return path


@pytest.fixture
def tokenizer():
    from tokenizers import AddedToken

    made = new_tokenizer(CORPUS, 320, ["<|eos|>", "<|pad|>"])
    made.add_tokens([AddedToken("', '", normalized=False, special=False)])
    return made


@pytest.mark.parametrize("dtype", ["F32", "F16", "Q8_0"])
@pytest.mark.parametrize("kv_heads", [2, 4])
def test_gguf_read_and_written_again_has_equal_bytes(tmp_path, tokenizer, dtype, kv_heads):
    size = tokenizer.get_vocab_size()
    first = written(tmp_path, random_llama(size, kv_heads=kv_heads), tokenizer, dtype=dtype)
    model = random_llama(size, kv_heads=kv_heads, seed=8)
    fill_from_gguf(model, first)
    again = written(tmp_path, model, read_gguf_tokenizer(first), "again", dtype)
    assert again.read_bytes() == first.read_bytes()


def test_tokens_of_the_shipped_planner_are_read_as_llama_cpp_has_them():
    import llama_cpp

    tokenizer = read_gguf_tokenizer(SHIPPED)
    model = llama_cpp.Llama(str(SHIPPED), vocab_only=True, verbose=False)
    for text in ("#task put a mug\n", "PutObject(robot, 'Mug', 'Sink')\n", "Überraschung 42  x"):
        ids = tokenizer.encode(text, add_special_tokens=False).ids
        assert ids == model.tokenize(text.encode(), add_bos=False, special=True)


def test_larger_vocabulary_keeps_the_embeddings_that_the_file_lacks(tmp_path, tokenizer):
    import torch

    size = tokenizer.get_vocab_size()
    model = random_llama(size)
    path = written(tmp_path, model, tokenizer)
    larger = random_llama(size + 3, seed=8)
    kept = larger.model.embed_tokens.weight[size:].clone()
    fill_from_gguf(larger, path)
    assert torch.equal(larger.model.embed_tokens.weight[size:], kept)
    assert torch.equal(larger.model.embed_tokens.weight[:size], model.model.embed_tokens.weight)


def test_what_is_no_fitting_gguf_is_refused_by_name(tmp_path, tokenizer):
    with pytest.raises(FileError, match="no such file"):
        read_gguf_tokenizer(tmp_path / "none.gguf")
    torn = Path(tmp_path / "torn.gguf")
    torn.write_bytes(b"GGUF torn")
    with pytest.raises(FileError, match=r"torn\.gguf: not a GGUF"):
        read_gguf_tokenizer(torn)
    path = written(tmp_path, random_llama(tokenizer.get_vocab_size()), tokenizer)
    with pytest.raises(ModelError, match="shape"):
        fill_from_gguf(random_llama(tokenizer.get_vocab_size(), kv_heads=4), path)
