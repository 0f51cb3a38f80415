"""A planner of random weights, small enough to make in a test: it babbles programs that parse."""

import hashlib
import json
import subprocess
import sys

from karma.models.llama.gguf_files import new_tokenizer
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.testing import Size, make_planner
from support.llama_export import EOS, export_llama, random_llama
from support.paths import ROOT

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
    size = Size(
        layers=4, width=256, heads=4, kv_heads=2, feed_forward=512, vocabulary=600, tied=True
    )
    return make_planner(folder / "made.gguf", size=size)


def opened(path, *, chat=None, thinking="off", thinking_tokens=1024, **options):
    """The model of a file that is vouched for, which saves the trial in another process."""
    return LlamaModel(
        path, sha256=hashlib.sha256(path.read_bytes()).hexdigest(), chat=chat,
        thinking=thinking, thinking_tokens=thinking_tokens,
        options=LlamaOptions(**{"threads": 1, **options}),
    )  # fmt: skip


def answer(model, prompt, **options):
    """Where the state came from, and the answer with the logits before it, to the bit."""
    first = model.complete(prompt, max_tokens=1)
    bits = hashlib.sha256(model.gguf.logits().tobytes()).hexdigest()
    return first.state, (model.complete(prompt, max_tokens=12, **options).text, bits)


_ELSEWHERE = """
import json, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from karma.types.planning import Prompt
from support.tiny import answer, opened
path, stable, changing = sys.argv[2:]
model = opened(Path(path), chat=False)
print(json.dumps(answer(model, Prompt(stable=stable, changing=changing))))
"""


def answer_elsewhere(path, prompt):
    """The answer of a process of its own."""
    words = (path, prompt.stable, prompt.changing)
    done = subprocess.run(
        [sys.executable, "-c", _ELSEWHERE, str(ROOT / "tests"), *map(str, words)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr == ""
    state, said = json.loads(done.stdout)
    return state, tuple(said)
