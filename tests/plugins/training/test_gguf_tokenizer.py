"""Tokenizers of GGUF files: tokens are those of llama.cpp."""

from support.paths import ROOT

from karma.plugins.training.gguf_tokenizer import read_gguf_tokenizer

SHIPPED = ROOT / "models" / "nano" / "planner.gguf"


def test_tokens_of_the_shipped_planner_are_read_as_llama_cpp_has_them():
    import llama_cpp

    tokenizer = read_gguf_tokenizer(SHIPPED)
    model = llama_cpp.Llama(str(SHIPPED), vocab_only=True, verbose=False)
    for text in ("#task put a mug\n", "PutObject(robot, 'Mug', 'Sink')\n", "Überraschung 42  x"):
        ids = tokenizer.encode(text, add_special_tokens=False).ids
        assert ids == model.tokenize(text.encode(), add_bos=False, special=True)


def test_tokens_of_a_gguf_whose_own_tokens_stand_ahead_of_others_are_read(tmp_path):
    """As in Qwen's: tokens that a user defined, then such as nothing uses."""
    import gguf
    import llama_cpp

    reader, path = gguf.GGUFReader(SHIPPED), tmp_path / "own.gguf"
    kinds = list(reader.fields["tokenizer.ggml.token_type"].contents())
    pieces = list(reader.fields["tokenizer.ggml.tokens"].contents())
    first = next(n for n, kind in enumerate(kinds) if kind == gguf.TokenType.CONTROL)
    pieces[first + 1 : first + 1] = ["<own>"]
    kinds[first + 1 : first + 1] = [gguf.TokenType.USER_DEFINED]
    writer = gguf.GGUFWriter(path, "llama")
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre(reader.fields["tokenizer.ggml.pre"].contents())
    writer.add_token_list(pieces)
    writer.add_token_types(kinds)
    writer.add_token_merges(reader.fields["tokenizer.ggml.merges"].contents())
    for step in (
        writer.write_header_to_file, writer.write_kv_data_to_file, writer.write_tensors_to_file,
        writer.close,
    ):  # fmt: skip
        step()
    ids = read_gguf_tokenizer(path).encode("put it <own> there", add_special_tokens=False).ids
    model = llama_cpp.Llama(str(path), vocab_only=True, verbose=False)
    assert first + 1 in ids
    assert ids == model.tokenize(b"put it <own> there", add_bos=False, special=True)
