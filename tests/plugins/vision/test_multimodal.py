"""Recall by words and pictures in one space."""

import numpy as np
import pytest
from support import tiny_models

from karma.agent.seeing.picture_states import keep
from karma.errors import FileError, KarmaError
from karma.plugins.vision.clip import ClipEmbedder
from karma.plugins.vision.multimodal import MultimodalRecall
from karma.types.memory import MemoryUnit


class Space:
    """Three axes: the word "mug", red pictures, everything else."""

    name, dimension = "space", 3

    def embed(self, texts):
        rows = [(1, 0, 0) if "mug" in text else (0, 1, 0) if "red" in text else (0, 0, 1)
                for text in texts]  # fmt: skip
        return np.array(rows, np.float32).reshape(-1, 3)

    def embed_images(self, frames):
        rows = [(0, 1, 0) if frame[0, 0, 0] > 128 else (0, 0, 1) for frame in frames]
        return np.array(rows, np.float32).reshape(-1, 3)


class Words:
    name, dimension = "words", 2

    def embed(self, texts):
        return np.ones((len(texts), 2), np.float32)


def unit(name, kind, image=None):
    return MemoryUnit(object_id=name, object_type=kind, position_m=(0.0, 0.0, 0.0), image=image)


@pytest.fixture
def units(tmp_path):
    red, blue = np.zeros((2, 8, 8, 3), np.uint8)
    red[..., 0], blue[..., 2] = 255, 255
    return (
        unit("blue", "Plate", keep(blue, tmp_path)),
        unit("red", "Plate", keep(red, tmp_path)),
        unit("mug", "Mug"),
    )


def test_of_two_with_equal_words_the_picture_decides(units, tmp_path):
    found = MultimodalRecall(Space(), folder=tmp_path).recall("the red one", units, 2)
    assert [item.unit.object_id for item in found] == ["red", "mug"]
    assert found[0].similarity == pytest.approx(0.5**0.5)


def test_unit_without_a_picture_stands_by_its_words(units, tmp_path):
    (best, *_) = MultimodalRecall(Space(), folder=tmp_path).recall("a mug", units, 3)
    assert (best.unit.object_id, best.similarity) == ("mug", pytest.approx(1.0))


def test_embedder_of_texts_alone_is_refused_with_what_helps():
    with pytest.raises(KarmaError, match="clip:NAME"):
        MultimodalRecall(Words())


def test_missing_picture_is_named(tmp_path):
    lost = unit("lost", "Mug", "short_term/images/none.png")
    with pytest.raises(FileError, match=r"none\.png"):
        MultimodalRecall(Space(), folder=tmp_path).recall("a mug", (lost,), 1)


def test_real_embedder_of_random_weights_ranks_units_with_pictures(units, tmp_path):
    embedder = ClipEmbedder(tiny_models.save_clip(tmp_path / "clip"))
    recall = MultimodalRecall(embedder, folder=tmp_path)
    found = recall.recall("the red plate", units, 3)
    assert {item.unit.object_id for item in found} == {"red", "blue", "mug"}
    assert found == MultimodalRecall(embedder, folder=tmp_path).recall("the red plate", units, 3)
    plates = [item.similarity for item in found if item.unit.object_type == "Plate"]
    assert plates[0] != plates[1]
