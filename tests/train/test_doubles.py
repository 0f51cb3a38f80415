"""Stand-ins fill their roles, and the fixtures made of them run the agent."""

import numpy as np

from karma.contracts import Embedder, LanguageModel, SeenObject, SubTask, VisionModel
from karma.train.testing import ScriptedModel, StubEmbedder, StubVision


def test_stub_embedder_gives_unit_rows_and_nears_what_shares_words():
    embedder: Embedder = StubEmbedder()
    rows = embedder.embed(["a red apple", "an apple, red", "apple red a", "", "the dirty plate"])
    assert np.allclose(np.linalg.norm(rows, axis=1), 1)
    assert rows[0] @ rows[2] > 0.99 > rows[0] @ rows[4]
    assert embedder.embed([]).shape == (0, embedder.dimension)
    assert np.array_equal(rows, StubEmbedder().embed(embedder.asked))


def test_stub_vision_reads_what_it_was_told():
    vision: VisionModel = StubVision({"Mug": ("dirty",)})
    seen = [
        SeenObject(
            object_id=f"{kind}|1", object_type=kind, position_m=(0, 0, 0), box_center_m=(0, 0, 0),
            box_size_m=(1, 1, 1), pickupable=True,
        )
        for kind in ("Mug", "Cup")
    ]  # fmt: skip
    assert vision.read_states(None, "wash it", seen) == {"Mug|1": ("dirty",), "Cup|1": ()}


def test_scripted_model_is_what_language_models_are():
    model: LanguageModel = ScriptedModel(["one", "two"])
    assert model.name == "scripted"


def test_fixture_begins_an_episode_that_acts_and_remembers(karma_episode):
    program = "PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', 'CounterTop')\n"
    episode = karma_episode([program], vision=StubVision({"Apple": ("sliced",)}))
    outcome = list(episode.do(SubTask(instruction="move the apple")))[-1]
    assert outcome.finished
    assert "Apple" in {unit.object_type for unit in episode.short_term.units()}
