"""A GGUF on a GPU: weights lie there, bits and words are those of the CPU, all of it is told.

The GPU is llama.cpp's RPC device on this machine, see `support.rpc_device`. Not covered: a card.
`test_devices.py` runs these tests in a process of their own.
"""

import numpy as np
import pytest
from support.rpc_device import rpc_device
from support.sights import about
from support.tiny import make_layers, opened

from karma.models.constraint import admits
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.vision import LlamaVision
from karma.models.manifest import PicturePair
from karma.testing import make_picture_model
from karma.types.planning import ProgramSpec, Prompt, Skill

PROMPT = Prompt(stable="#areas\nnode_1 Fridge Sink\n" * 12, changing="#task go\n#program\n")
SPEC = ProgramSpec(
    skills=(Skill(name="GoToObject", arguments=("object",)),),
    objects=("Apple", "Fridge"), max_calls=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def gpu():
    return rpc_device()


@pytest.fixture(scope="module")
def gguf(tmp_path_factory):
    return make_layers(tmp_path_factory.mktemp("m"))


def test_offloaded_model_has_its_weights_over_there(gpu, gguf):
    before = gpu.memory_mb()
    there, here = opened(gguf), opened(gguf, gpu_layers=0)
    said, wanted = (one.complete(PROMPT, max_tokens=8) for one in (there, here))
    assert said.engine.device.startswith("RPC")
    assert (said.engine.gpu_layers, wanted.engine.gpu_layers) == (5, 0)
    assert wanted.engine.device == "CPU"
    assert gpu.memory_mb() - before > 0.9 * gguf.stat().st_size / 1e6
    assert said.text == wanted.text
    assert np.abs(there.gguf.logits() - here.gguf.logits()).max() < 0.2
    there.close()


def test_flash_attention_is_on_by_itself_on_a_gpu_only(gpu, gguf):
    there, here = opened(gguf, gpu_layers=2), opened(gguf, gpu_layers=0)
    for model in (there, here):
        model.complete(PROMPT, max_tokens=1)
    assert (there.gguf.engine.flash_attention, here.gguf.engine.flash_attention) == (True, False)
    assert there.gguf.engine.gpu_layers == 2
    assert np.abs(there.gguf.logits() - here.gguf.logits()).max() < 0.2
    there.close()


def test_constrained_answers_of_an_offloaded_model_are_programs(gpu, gguf):
    model = opened(gguf)
    for seed in range(20):
        text = model.complete(PROMPT, spec=SPEC, temperature=1.0, seed=seed).text
        assert admits(SPEC.grammar, text)
    model.close()


def test_offloaded_model_scores_and_grows(gpu, gguf):
    there, here = opened(gguf), opened(gguf, gpu_layers=0)
    texts = ["GoToObject(robot, 'Apple')\n", "GoToObject(robot, 'Fridge')\n", ""]
    long = (PROMPT.stable * 4, PROMPT.changing)
    for prompt in ((PROMPT.stable, PROMPT.changing), long):
        one, other = (model.choose(prompt, texts) for model in (there, here))
        assert one.number == other.number
        assert one.score == pytest.approx(other.score, abs=1e-1)
    there.complete(Prompt(stable=long[0], changing=long[1]), max_tokens=4)
    assert there.gguf.n_ctx > 512
    there.close()


def test_pictures_are_answered_with_the_same_words(gpu, tmp_path):
    made = make_picture_model(tmp_path / "pair", "llava")
    pair = PicturePair(name="llava", model=made.model, projector=made.projector)
    far = LlamaVision(pair, llama_options=LlamaOptions(threads=1))
    near = LlamaVision(pair, llama_options=LlamaOptions(threads=1, gpu_layers=0))
    assert (far.engine.device, near.engine.device) == ("RPC0", "CPU")
    assert far.engine.gpu_layers > 0
    frame = np.random.default_rng(3).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    said = [chat.answer(about(frame), max_tokens=8) for chat in (far, near)]
    assert said[0] == said[1] != ""
    far.close()
    near.close()
