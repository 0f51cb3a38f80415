"""Export a plain Llama in PyTorch and a byte-level BPE tokenizer as one GGUF file."""

from pathlib import Path

import numpy as np

from karma.models.llama.gguf_files import (
    add_special_tokens,
    add_vocabulary,
    interleave,
    write_gguf,
)

EOS = "<|eos|>"
_USUAL = {
    "tie_word_embeddings": True, "intermediate_size": 160, "max_position_embeddings": 256
}  # fmt: skip


def random_llama(vocab_size, *, width=64, layers=2, heads=4, kv_heads=2, seed=7, **more):
    """A Llama of random weights, with logits as far apart as a trained one's."""
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    torch.manual_seed(seed)
    config = LlamaConfig(
        vocab_size=vocab_size, hidden_size=width, num_hidden_layers=layers,
        num_attention_heads=heads, num_key_value_heads=kv_heads, initializer_range=0.2,
        **{**_USUAL, **more},
    )  # fmt: skip
    return LlamaForCausalLM(config).eval()


def export_llama(
    model, tokenizer, path, *, name="tiny", bos=None, pad=None, add_bos=False, dtype="F16",
    template=None, licence=None,
):  # fmt: skip
    """Write a GGUF that llama.cpp runs with the same tokens and, in F32, the same logits.

    `tokenizer` is one of `new_tokenizer`, with the token "<|eos|>"; `dtype` is of the matrices.
    """

    def fill(writer):
        writer.add_name(name)
        if licence is not None:
            writer.add_license(licence)
        _add_shape(writer, model.config, dtype)
        add_vocabulary(writer, tokenizer, model.config.vocab_size)
        add_special_tokens(writer, tokenizer, {"bos": bos, "eos": EOS, "pad": pad}, add_bos=add_bos)
        if template is not None:
            writer.add_chat_template(template)
        for tensor, array in _tensors(model):
            _add_tensor(writer, tensor, array, dtype)

    write_gguf(Path(path), fill)
    return path


def _add_shape(writer, config, dtype):
    import gguf

    head = config.hidden_size // config.num_attention_heads
    writer.add_context_length(config.max_position_embeddings)
    writer.add_embedding_length(config.hidden_size)
    writer.add_block_count(config.num_hidden_layers)
    writer.add_feed_forward_length(config.intermediate_size)
    writer.add_vocab_size(config.vocab_size)
    writer.add_head_count(config.num_attention_heads)
    writer.add_head_count_kv(config.num_key_value_heads)
    writer.add_key_length(head)
    writer.add_value_length(head)
    writer.add_layer_norm_rms_eps(config.rms_norm_eps)
    writer.add_rope_freq_base(10000.0)
    writer.add_rope_dimension_count(head)
    writer.add_file_type(gguf.LlamaFileType["ALL_F32" if dtype == "F32" else f"MOSTLY_{dtype}"])
    writer.add_quantization_version(gguf.GGML_QUANT_VERSION)


def _tensors(model):
    """Yield GGUF names and float32 arrays, in the order of the state dict."""
    import gguf

    config = model.config
    names = gguf.get_tensor_name_map(gguf.MODEL_ARCH.LLAMA, config.num_hidden_layers)
    heads = {"attn_q": config.num_attention_heads, "attn_k": config.num_key_value_heads}
    for key, tensor in model.state_dict().items():
        name = names.get_name(key, try_suffixes=(".weight",))
        if name != "output.weight" or not config.tie_word_embeddings:
            array = np.ascontiguousarray(tensor.detach().float().numpy())
            part = name.split(".")[-2]
            yield name, interleave(array, heads[part]) if part in heads else array


def _add_tensor(writer, name, array, dtype):
    import gguf

    if array.ndim == 1 or dtype == "F32":
        writer.add_tensor(name, array)
    elif dtype == "F16":
        writer.add_tensor(name, array.astype(np.float16))
    else:
        kind = gguf.GGMLQuantizationType[dtype]
        writer.add_tensor(name, gguf.quants.quantize(array, kind), raw_dtype=kind)
