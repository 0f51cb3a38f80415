"""A planner of random weights, small enough to make in a test: it babbles programs that parse."""

import hashlib

from karma.infer.llama.gguf_files import new_tokenizer
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.opening import LlamaOptions
from karma.train.testing import make_llama
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


def make_layers(folder):
    """A file of four layers, which can be placed one by one."""
    return make_llama(
        folder / "made.gguf", layers=4, width=256, heads=4, kv_heads=2, feed_forward=512,
        vocabulary=600,
    )  # fmt: skip


def opened(path, *, states=None, chat=None, **options):
    """The model of a file that is vouched for, which saves the trial in another process."""
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    chosen = LlamaOptions(**{"threads": 1, **options})
    return LlamaModel(path, sha256=sha256, options=chosen, states=states, chat=chat)
