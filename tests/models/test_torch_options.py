"""Where torch models are computed; several pictures at once."""

import os
import subprocess
import sys

import numpy as np
import pytest
from support.sights import seen
from support.tiny_vision import save_family

from karma import registry
from karma.models.torch_load import TorchOptions, device_of
from karma.models.transformers_vision import TransformersVision, VisionOptions

FRAME = np.random.default_rng(0).integers(0, 255, (300, 300, 3), dtype=np.uint8)


def mug(number):
    left = 20.0 + 40 * number
    return seen(f"Mug|{number}", region=(left, 90.0, left + 30, 150.0))


def test_auto_is_the_cpu_where_there_is_no_card():
    import torch

    assert device_of(TorchOptions()) == ("cuda" if torch.cuda.is_available() else "cpu")


def test_pictures_together_are_answered_as_one_by_one():
    options = registry.load("vision_models", "nano-vlm")().options
    objects = [mug(number) for number in range(5)]
    told = []
    for batch in (1, 3):
        chosen = VisionOptions(**{**_plain(options), "batch": batch})
        model = TransformersVision(options=chosen)
        told.append(model.read_states(FRAME, "wash the mug", objects))
    assert told[0] == told[1]


def _plain(options):
    return {name: getattr(options, name) for name in options.__struct_fields__}


@pytest.mark.parametrize("family", ["llava", "idefics3", "smolvlm", "qwen2_5_vl"])
def test_family_takes_several_pictures_at_once(family, tmp_path):
    model = TransformersVision(
        save_family(family, tmp_path / family), options=VisionOptions(max_tokens=4)
    )
    asked = [{"role": "user", "content": [{"type": "image"}, {"type": "text", "text": "What?"}]}]
    longer = [
        {"role": "user", "content": [{"type": "image"}, {"type": "text", "text": "Yes? " * 9}]}
    ]
    frames = [FRAME, FRAME[:200, :160]]
    both = model.answer_all(frames, [asked, longer])
    assert both == [model.answer(frames[0], asked), model.answer(frames[1], longer)]


def test_transformers_is_never_let_fetch_kernels():
    program = (
        "from karma.models.torch_load import import_transformers\n"
        "import os\n"
        "import_transformers()\n"
        "print(os.environ['USE_HUB_KERNELS'])\n"
    )
    clean = {name: value for name, value in os.environ.items() if name != "USE_HUB_KERNELS"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=clean, capture_output=True, text=True, check=True
    )
    assert done.stdout == "0\n"
