"""Each family's own architecture, small and of random weights, through its real files."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from support.sights import seen
from support.tiny_vision import FAMILIES, save_family

from karma.errors import KarmaError
from karma.plugins.vision import vlm
from karma.plugins.vision.cutting import LINE, cut
from karma.plugins.vision.vlm import TransformersVision, VisionOptions

MUG = seen("Mug|1", region=(100.0, 100.0, 160.0, 180.0))
FRAME = np.random.default_rng(0).integers(0, 255, (300, 300, 3), dtype=np.uint8)
SHORT = VisionOptions(max_tokens=6)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("vision")
    return {family: save_family(family, root / family) for family in FAMILIES}


@pytest.fixture
def copied(folders, tmp_path):
    return shutil.copytree(folders["llava"], tmp_path / "model")


class Saying(TransformersVision):
    """A real model whose words are put into its mouth; the rest of the adapter is as it is."""

    def say(self, *answers):
        self.answers, self.heard, self.pictures = list(answers), [], []
        return self

    def answer(self, image, messages, *, most=0):
        if most:
            return super().answer(image, messages, most=most)
        super().answer(image, messages[:2])
        self.heard.append([dict(message) for message in messages])
        self.pictures.append(image)
        return self.answers.pop(0)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_model_of_each_family_looks_and_says_something(folders, family):
    assert sum(file.stat().st_size for file in folders[family].iterdir()) < 600_000
    model = TransformersVision(folders[family], options=SHORT)
    assert model.name == family
    states = model.read_states(FRAME, "wash the mug", [MUG])
    assert set(states) <= {"Mug|1"}
    assert model.read_states(FRAME, "wash the mug", [MUG]) == states


def test_the_paper_s_question_reaches_the_model_with_the_picture(folders):
    model = Saying(folders["llava"], options=SHORT).say("1. A mug.\nMug: dirty")
    assert model.read_states(FRAME, "wash the mug", [MUG]) == {"Mug|1": ("dirty",)}
    system, user = model.heard[0]
    assert "image analysis expert" in system["content"][0]["text"]
    assert [part["type"] for part in user["content"]] == ["image", "text"]
    assert "wash the mug" in user["content"][1]["text"]
    assert model.pictures[0] is FRAME


def test_an_unusable_answer_is_quoted_once_and_then_left_out(folders):
    model = Saying(folders["llava"], options=SHORT).say("Mug: sparkling", "Mug: cleaned")
    assert model.read_states(FRAME, "look", [MUG]) == {"Mug|1": ("cleaned",)}
    assert "'sparkling' is not a state" in model.heard[1][-1]["content"][0]["text"]
    model.say("no idea", "still none")
    assert model.read_states(FRAME, "look", [MUG]) == {}
    assert len(model.heard) == 2


def test_a_model_with_crops_is_asked_about_one_thing_at_a_time(folders):
    options = VisionOptions(profile="compact", crop=1.5, max_tokens=4, attempts=1)
    model = Saying(folders["llava"], options=options).say("Mug: off")
    assert model.read_states(FRAME, "look", [MUG, seen("Mug|2")]) == {"Mug|1": ("off",)}
    assert model.pictures[0].shape == (120, 120, 3)


def test_karma_json_says_how_a_model_is_asked(copied):
    (copied / "karma.json").write_text('{"profile": "compact", "crop": 1.4, "max_tokens": 9}')
    assert TransformersVision(copied).options == VisionOptions(
        profile="compact", crop=1.4, max_tokens=9
    )
    (copied / "karma.json").write_text('{"profil": "compact"}')
    with pytest.raises(KarmaError, match=r"karma\.json.*profil"):
        TransformersVision(copied)


# ------------------------------------------------------------------ what is refused


def test_a_large_model_that_is_stored_in_16_bits_stays_so(copied, monkeypatch):
    import torch
    from transformers import LlavaForConditionalGeneration

    monkeypatch.setattr(vlm, "LARGE", 1000)
    assert TransformersVision(copied)._model.dtype == torch.float32
    whole = LlavaForConditionalGeneration.from_pretrained(copied, dtype=torch.bfloat16)
    whole.save_pretrained(copied)
    half = TransformersVision(copied, options=SHORT)
    assert half._model.dtype == torch.bfloat16
    half.read_states(FRAME, "look", [MUG])


# ------------------------------------------------------------------ crops


def test_a_silhouette_is_drawn_into_the_crop_and_nowhere_else():
    corners = ((110.0, 110.0), (150.0, 110.0), (150.0, 170.0), (110.0, 170.0))
    plain = cut(FRAME, (100, 100, 160, 180), 1.5)
    drawn = cut(FRAME, (100, 100, 160, 180), 1.5, corners)
    ys, xs = np.nonzero((drawn != plain).any(axis=-1))
    assert set(map(tuple, drawn[ys, xs].tolist())) == {LINE}
    assert abs(xs.min() - 40) <= 1 and abs(xs.max() - 80) <= 1
    assert abs(ys.min() - 30) <= 1 and abs(ys.max() - 90) <= 1
    assert (drawn[40:80, 50:70] == plain[40:80, 50:70]).all()


def test_a_crop_is_square_and_centred_and_black_beyond_the_frame():
    crop = cut(FRAME, (100, 100, 160, 180), 1.5)
    assert crop.shape == (120, 120, 3)
    assert (crop == FRAME[80:200, 70:190]).all()
    corner = cut(FRAME, (0, 0, 40, 40), 2.0)
    assert corner.shape == (80, 80, 3)
    assert not corner[:20].any()
    assert (corner[20:, 20:] == FRAME[:60, :60]).all()


def test_small_things_are_shown_with_more_around_them():
    assert cut(FRAME, (100, 100, 104, 103), 1.5).shape == (32, 32, 3)


def test_transformers_is_never_let_fetch_kernels():
    program = (
        "from karma.plugins.vision.torch_load import import_transformers\n"
        "import os\n"
        "import_transformers()\n"
        "print(os.environ['USE_HUB_KERNELS'])\n"
    )
    clean = {name: value for name, value in os.environ.items() if name != "USE_HUB_KERNELS"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=clean, capture_output=True, text=True, check=True
    )
    assert done.stdout == "0\n"
