"""A planner of random weights, small enough to make in a test: it babbles programs that parse."""

import hashlib

from karma.infer.llama.gguf_files import new_tokenizer
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.opening import LlamaOptions
from karma.train.testing import make_llama
from support.llama_export import EOS, export_llama, random_llama

CORPUS = ["#task put the apple in the fridge\n#memory\n @Fridge *Apple\n#program\n"]


def export_tiny(path, template=None, dtype="F16", layers=1):
    model = random_llama(
        400, width=32, layers=layers, heads=2, seed=3, intermediate_size=64,
        max_position_embeddings=4096,
    )  # fmt: skip
    return export_llama(
        model, new_tokenizer(CORPUS, 400, [EOS]), path, dtype=dtype, template=template
    )


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
