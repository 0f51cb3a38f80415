"""A row that sees by pictures: its map, its detector, its recall."""

from types import SimpleNamespace

import pytest
from support import tiny_models
from support.experiences import Words
from support.household import kitchen

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.agent.seeing.eyes import perception_of
from karma.errors import KarmaError, UnknownNameError
from karma.files import to_json
from karma.loading.models import Models, load_resources, world_maker
from karma.memory.recall import CosineRecall
from karma.models.scripted import BlindVision, MetadataVision, ScriptedModel
from karma.plugins.vision import perception
from karma.plugins.vision.multimodal import MultimodalRecall
from karma.types.completion import Decoding
from karma.types.space import SceneRef
from karma.types.tasks import SubTask

LOOKS = {"perception": "pictures"}


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "room.json"
    path.write_bytes(to_json(kitchen()))
    return SceneRef.of(str(path))


def method(tmp_path, *, vision=None, maps=None, **settings):
    model = ScriptedModel(["Explore(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"] * 9)
    return KarmaMethod(
        Planner(model, "compact", Decoding(attempts=1)),
        CosineRecall(Words(), text="sentence"),
        vision or BlindVision(),
        KarmaSettings(perception="pictures", **settings),
        maps=maps,
    )


def done(made, scene, tmp_path, seed=0):
    world = world_maker("embedded", [LOOKS])()
    world.reset(scene.source)
    episode = made.begin(world, scene, seed=seed, folder=tmp_path)
    task = SubTask(instruction="Bring me the apple.", whole="Bring me the apple.")
    return episode, [*episode.do(task)][-1], world


def test_agent_that_sees_by_given_boxes_does_what_it_is_told(scene, tmp_path):
    _, outcome, world = done(method(tmp_path, long_term=False), scene, tmp_path)
    assert outcome.finished
    assert world.last_event.metadata["inventoryObjects"][0]["objectId"].startswith("Apple")


def test_map_from_pictures_lies_apart_and_only_of_the_room_as_it_is(scene, tmp_path):
    maps = tmp_path / "maps"
    maps.mkdir()
    done(method(tmp_path, maps=maps), scene, tmp_path, seed=1)
    assert list(maps.iterdir()) == []
    first, _, _ = done(method(tmp_path, maps=maps), scene, tmp_path)
    assert [path.name for path in maps.iterdir()] == ["room.given.json"]
    again, _, _ = done(method(tmp_path, maps=maps), scene, tmp_path)
    assert first.memory.graph == again.memory.graph


def test_models_of_a_run_hold_the_multimodal_recall(tmp_path):
    clip = tiny_models.save_clip(tmp_path / "clip")
    models = Models(vision="blind", embedder=f"clip:{clip}", recall="multimodal")
    loaded = load_resources(models, maps=tmp_path / "maps", seed=0)
    assert isinstance(loaded.recall, MultimodalRecall)


def test_detector_is_named_after_the_perception(monkeypatch):
    monkeypatch.setattr(perception, "_loaded", lambda name: SimpleNamespace(name=name))
    made = perception_of("pictures:mine", BlindVision())
    assert made.map_file("kitchen_1", 0) == "kitchen_1.detector.json"
    assert made.eyes("kitchen_1", "wash the mug") is made.eyes("kitchen_1", "dry it")
    with pytest.raises(KarmaError, match="states of given boxes"):
        perception_of("pictures:mine", MetadataVision())


@pytest.mark.parametrize("name", ["picture", "pictures2"])
def test_unknown_perception_is_refused_with_the_nearest_name(name):
    with pytest.raises(UnknownNameError, match="Did you mean 'pictures'"):
        KarmaSettings(perception=name)
