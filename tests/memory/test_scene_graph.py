"""Long-term memory covers the room, grows as objects are seen, and survives on disk and as text."""

from collections import deque
from dataclasses import replace
from math import dist, isclose, prod

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.errors import FileError
from karma.memory.scene_graph import RADIUS_M, AreaNode, SceneGraph
from karma.types.memory import Known
from karma.types.observation import SeenObject

CELL = 0.25
HERE = (0.0, 0.0, 1.0)
GRID = st.sets(st.tuples(st.integers(0, 14), st.integers(0, 14)), min_size=1, max_size=120)
METRES = st.integers(-32, 48).map(lambda steps: steps * CELL)


def metres(grid):
    return [(-1.0 + CELL * i, 0.5 + CELL * j) for i, j in grid]


def room(width=12, depth=10):
    return metres((i, j) for i in range(width) for j in range(depth))


AREAS = tuple(SceneGraph.over(room())._areas.values())  # covered once: it takes a while


def furnished(seen=()):
    graph = SceneGraph(AREAS)
    graph.observe(seen)
    return graph


def thing(kind, x, z, *, number=1, size=(0.5, 1.0, 0.5), pickupable=False):
    return SeenObject(
        object_id=f"{kind}|{number}",
        object_type=kind,
        position_m=(x, 0.5, z),
        box_center_m=(x, 0.5, z),
        box_size_m=size,
        pickupable=pickupable,
    )


@st.composite
def things(draw):
    """Different objects anywhere near the room."""
    kinds = draw(st.lists(st.sampled_from(["Bed", "Fridge", "Cabinet", "Apple"]), max_size=12))
    return [
        thing(kind, draw(METRES), draw(METRES), number=number, pickupable=kind == "Apple")
        for number, kind in enumerate(kinds)
    ]


def on_foot(cells, start):
    """Walking distance in metres from a cell, by a search of the test's own."""
    free = {(round(x / CELL), round(z / CELL)): (x, z) for x, z in cells}
    at = (round(start[0] / CELL), round(start[1] / CELL))
    steps, queue = {at: 0}, deque([at])
    while queue:
        i, j = queue.popleft()
        for other in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if other in free and other not in steps:
                steps[other] = steps[(i, j)] + 1
                queue.append(other)
    return {free[cell]: count * CELL for cell, count in steps.items()}


def area_of(graph, object_id):
    """The name of the area that holds an object, None if none does."""
    places = (area.name for area in graph.areas())
    return next((a for a in places if object_id in {n.id for n in graph.objects(a)}), None)


def beside(graph):
    return {area.name: area.adjacent for area in graph.areas()}


def reachable_areas(graph, start):
    found, queue, adjacent = {start}, deque([start]), beside(graph)
    while queue:
        for other in adjacent[queue.popleft()]:
            if other not in found:
                found.add(other)
                queue.append(other)
    return found


# ----------------------------------------------------------------- areas


@settings(max_examples=40)
@given(grid=GRID, spacing=st.sampled_from([0.25, 0.75, 1.25]))
def test_every_cell_is_a_short_walk_from_an_area_node(grid, spacing):
    cells = metres(grid)
    graph = SceneGraph.over(cells, spacing_m=spacing)
    nearest = {}
    for area in graph.areas():
        x, y, z = area.position_m
        assert (x, z) in cells
        assert y == 0.0
        for cell, distance in on_foot(cells, (x, z)).items():
            nearest[cell] = min(distance, nearest.get(cell, distance))
    assert set(nearest) == set(cells)
    assert max(nearest.values()) <= spacing


@settings(max_examples=40)
@given(grid=GRID)
def test_areas_are_connected_exactly_where_cells_are(grid):
    cells = metres(grid)
    graph = SceneGraph.over(cells)
    place = {area.name: (area.position_m[0], area.position_m[2]) for area in graph.areas()}
    for name, start in place.items():
        walkable = on_foot(cells, start)
        assert reachable_areas(graph, name) == {n for n, at in place.items() if at in walkable}
        for other in beside(graph)[name]:
            assert name in beside(graph)[other]
            assert name != other


def test_room_gets_few_evenly_spread_areas():
    graph = SceneGraph.over(room(14, 12), height_m=0.01)
    places = [area.position_m for area in graph.areas()]
    assert 6 <= len(places) <= 14
    assert min(dist(a, b) for a in places for b in places if a != b) >= 0.5
    assert {place[1] for place in places} == {0.01}
    assert [area.name for area in graph.areas()] == [f"node_{i + 1}" for i in range(len(places))]


# ----------------------------------------------------------------- objects


@given(seen=things(), data=st.data())
def test_any_order_and_batches_give_one_graph(seen, data):
    at_once, bit_by_bit = furnished(seen), furnished()
    left = data.draw(st.permutations(seen))
    while left:
        size = data.draw(st.integers(1, len(left)))
        bit_by_bit.observe(left[:size])
        bit_by_bit.observe(left[:1])  # seen again
        left = left[size:]
    assert bit_by_bit == at_once
    assert bit_by_bit.to_text() == at_once.to_text()


@given(seen=things())
def test_each_immovable_object_in_reach_belongs_to_its_nearest_area(seen):
    graph = furnished(seen)
    kept = {node.id: node for node in graph.objects()}
    for item in seen:
        (x, _, z), (w, _, d) = item.box_center_m, item.box_size_m
        gaps = {}
        for area in graph.areas():
            ax, _, az = area.position_m
            gaps[area.name] = dist(
                (ax, az), (min(max(ax, x - w / 2), x + w / 2), min(max(az, z - d / 2), z + d / 2))
            )
        nearest = min(gaps.values())
        in_reach = nearest <= RADIUS_M and not item.pickupable
        assert (item.object_id in kept) == in_reach
        if in_reach:
            assert isclose(gaps[area_of(graph, item.object_id)], nearest, abs_tol=1e-9)
            assert kept[item.object_id].volume_m3 == prod(item.box_size_m)
    assert graph.objects() == tuple(
        sorted((n for a in graph.areas() for n in graph.objects(a.name)), key=lambda n: n.id)
    )


def test_moved_object_is_found_where_it_is_now():
    graph = SceneGraph.over(room())
    graph.observe([thing("ArmChair", 0.0, 1.0)])
    before = area_of(graph, "ArmChair|1")
    graph.observe([thing("ArmChair", 1.5, 2.5)])
    assert graph.known("ArmChair", near=HERE).position_m == (1.5, 0.5, 2.5)
    assert area_of(graph, "ArmChair|1") != before
    graph.observe([thing("ArmChair", 40.0, 40.0)])
    assert graph.known("ArmChair", near=HERE) is None


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("key", ["position_m", "box_center_m", "box_size_m"])
def test_what_has_no_position_was_not_seen_and_what_was_known_stays(bad, key, tmp_path):
    fridge = thing("Fridge", 0.5, 0.5)
    graph = furnished([fridge])
    before = graph.objects()
    for axis in range(3):
        torn = list(getattr(fridge, key))
        torn[axis] = bad
        other = replace(thing("Bed", 0.5, 0.5), **{key: tuple(torn)})
        graph.observe([replace(fridge, **{key: tuple(torn)}), other])
        assert graph.objects() == before
    graph.save(tmp_path / "map.json")
    assert SceneGraph.load(tmp_path / "map.json") == graph


def test_known_finds_by_id_and_the_nearest_by_type():
    graph = SceneGraph.over(room())
    graph.observe([thing("Cabinet", x, 1.0, number=n) for n, x in ((1, 0.0), (2, 1.0), (3, 0.0))])
    found = graph.known("Cabinet", near=(1.25, 0.0, 1.0))
    node = next(one for one in graph.objects() if one.id == "Cabinet|2")
    assert found == Known(
        object_id="Cabinet|2",
        object_type="Cabinet",
        position_m=(1.0, 0.5, 1.0),
        box_center_m=node.box_center_m,
        box_size_m=node.box_size_m,
    )
    assert graph.known("Cabinet", near=HERE).object_id == "Cabinet|1"
    assert graph.known("Cabinet|3", near=HERE).object_id == "Cabinet|3"
    assert graph.known("Sofa", near=HERE) is None


# ----------------------------------------------------------------- text


def test_text_has_the_form_of_the_paper():
    graph = SceneGraph(
        (
            AreaNode(name="node_1", position_m=(2.341, 0.0, 2.23), adjacent=("node_2", "node_8")),
            AreaNode(name="node_2", position_m=(0.5, -0.001, -1.0), adjacent=("node_1",)),
            AreaNode(name="node_8", position_m=(9.0, 0.0, 9.0), adjacent=("node_1",)),
        )
    )
    graph.observe([thing("Window", 2.0, 2.0), thing("Bed", 2.5, 2.5), thing("Sofa", 0.5, -1.5)])
    assert graph.to_text().splitlines() == [
        "{name: node_1, type: Area, contains: [Bed, Window],"
        " adjacent nodes: [node_2, node_8], position: [2.34, 0.00, 2.23]}",
        "{name: node_2, type: Area, contains: [Sofa],"
        " adjacent nodes: [node_1], position: [0.50, 0.00, -1.00]}",
        "{name: node_8, type: Area, contains: [],"
        " adjacent nodes: [node_1], position: [9.00, 0.00, 9.00]}",
        "node_1 <-> node_2",
        "node_1 <-> node_8",
    ]


# ----------------------------------------------------------------- disk


@settings(max_examples=25)
@given(grid=GRID, seen=things())
def test_saved_graph_is_equal_after_a_restart(grid, seen, tmp_path_factory):
    path = tmp_path_factory.mktemp("graph") / "graph.json"
    graph = SceneGraph.over(metres(grid))
    graph.observe(seen)
    graph.save(path)
    again = SceneGraph.load(path)
    assert again == graph
    assert again.to_text() == graph.to_text()
    graph.observe([thing("Sofa", 0.0, 1.0)])
    again.observe([thing("Sofa", 0.0, 1.0)])
    assert again == graph


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "graph.json"
    graph = SceneGraph.over(room())
    graph.observe([thing("Bed", 0.0, 1.0), thing("Desk", 1.5, 2.5)])
    graph.save(path)
    return path


@pytest.mark.parametrize(
    "spoil, says",
    [
        (lambda text: text[:200], "truncated"),
        (lambda text: text.replace('"version": 1', '"version": 9'), "version 9, expected 1"),
        (lambda text: text.replace('"radius_m"', '"radius"'), "radius"),
    ],
)
def test_damaged_file_is_named_with_what_is_wrong(saved, spoil, says):
    saved.write_text(spoil(saved.read_text()))
    with pytest.raises(FileError, match=says) as caught:
        SceneGraph.load(saved)
    assert caught.value.path == saved
