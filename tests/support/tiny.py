"""A planner of random weights, small enough to make in a test: it babbles programs that parse."""

from karma.infer.llama.gguf_files import new_tokenizer
from support.llama_export import export_llama_gguf

CORPUS = ["#task put the apple in the fridge\n#memory\n @Fridge *Apple\n#program\n"]


def export_tiny(path, template=None, dtype="F16", layers=1):
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    torch.manual_seed(3)
    config = LlamaConfig(
        vocab_size=400, hidden_size=32, intermediate_size=64, num_hidden_layers=layers,
        num_attention_heads=2, num_key_value_heads=2, max_position_embeddings=4096,
        tie_word_embeddings=True, initializer_range=0.2,
    )  # fmt: skip
    tokenizer = new_tokenizer(CORPUS, 400, ["<|eos|>"])
    export_llama_gguf(
        LlamaForCausalLM(config), tokenizer, path, name="tiny", eos_token="<|eos|>", dtype=dtype,
        chat_template=template,
    )  # fmt: skip
    return path
