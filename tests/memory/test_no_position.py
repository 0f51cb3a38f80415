"""A thing whose position is no number was not seen: what was known of it stays."""

from dataclasses import replace

import pytest

from karma.contracts import SeenObject
from karma.memory.scene_graph import SceneGraph

FRIDGE = SeenObject(
    object_id="Fridge|1", object_type="Fridge", position_m=(0.5, 0.9, 0.5), pickupable=False,
    box_center_m=(0.5, 0.9, 0.5), box_size_m=(0.6, 1.8, 0.6),
)  # fmt: skip


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("key", ["position_m", "box_center_m", "box_size_m"])
def test_furniture_stays_on_the_map_and_the_map_can_be_read(bad, key, tmp_path):
    graph = SceneGraph.over([(0.0, 0.0), (0.25, 0.0), (0.25, 0.25)])
    graph.observe([FRIDGE])
    before = graph.objects()
    for axis in range(3):
        torn = list(getattr(FRIDGE, key))
        torn[axis] = bad
        graph.observe([replace(FRIDGE, **{key: tuple(torn)})])
        graph.observe([replace(FRIDGE, object_id="Bed|1", object_type="Bed", **{key: tuple(torn)})])
        assert graph.objects() == before
    graph.save(tmp_path / "map.json")
    assert SceneGraph.load(tmp_path / "map.json") == graph
