"""A house that contradicts itself is refused; file, key and what is wrong there are named."""

import copy
import json
import math

import pytest
from support.tiny_house import tiny_house, xyz
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.plugins.thor_tools.importing.house_record import MOST_DEEP
from karma.plugins.thor_tools.importing.procthor import house_scene, import_houses


def nested(depth):
    """Return boxes in one another."""
    found = {"id": "Box|2|0", "position": xyz(1, 0.2, 3)}
    for number in range(1, depth):
        found = {"id": f"Box|2|{number}", "position": xyz(1, 0.2, 3), "children": [found]}
    return found


def set_at(*path):
    """Return a change that sets the last of a path's keys, or without a value removes it."""

    def change(house):
        *keys, last, value = path
        for key in keys:
            house = house[key]
        if value is None:
            del house[last]
        else:
            house[last] = value

    return change


def also(key, value):
    """Return a change that adds one more to a list."""
    return lambda house: house[key].append(value)


def twice(key):
    """Return a change that writes the first of a list once more."""
    return lambda house: house[key].append(copy.deepcopy(house[key][0]))


LAMP = {"id": "FloorLamp|3|7", "position": xyz(5, 0.8, 3)}
BROKEN = {
    "no walls": (set_at("walls", None), "missing required field `walls`"),
    "no floor": (set_at("rooms", 1, "floorPolygon", None), "`floorPolygon` - at `$.rooms[1]`"),
    "no position": (set_at("objects", 0, "position", None), "`position` - at `$.objects[0]`"),
    "a child's point lacks z": (
        set_at("objects", 0, "children", 1, "position", "z", None),
        "`z` - at `$.objects[0].children[1].position`",
    ),
    "word for a number": (set_at("walls", 2, "polygon", 0, "x", "left"), "$.walls[2].polygon[0].x"),
    "other kind of room": (set_at("rooms", 0, "roomType", "Attic"), "'Attic' - at `$.rooms[0]"),
    "no rooms": (set_at("rooms", []), "rooms: there are none"),
    "floor of two points": (
        set_at("rooms", 1, "floorPolygon", [xyz(4, 0, 0), xyz(8, 0, 4)]),
        "rooms[1].floorPolygon: 2 different points; a floor has 3",
    ),
    "floor of one point thrice": (
        set_at("rooms", 1, "floorPolygon", [xyz(4, 0, 0)] * 3),
        "rooms[1].floorPolygon: 1 different points",
    ),
    "floor without area": (
        set_at("rooms", 1, "floorPolygon", [xyz(4, 0, 0), xyz(6, 0, 2), xyz(8, 0, 4)]),
        "rooms[1].floorPolygon: the floor's area",
    ),
    "upper floor": (
        set_at("rooms", 1, "floorPolygon", 2, "y", 3.0),
        "rooms[1].floorPolygon: not level",
    ),
    "endless house": (set_at("rooms", 1, "floorPolygon", 3, "x", 900.0), "longer than 200 m"),
    "other schema": (set_at("metadata", "schema", "7.0.0"), "metadata.schema: '7.0.0'"),
    "thing outside": (
        also("objects", {**LAMP, "position": xyz(50, 0.8, 3)}),
        "objects[1].position: 'FloorLamp|3|7' lies outside the house",
    ),
    "thing in the L's corner": (
        also("objects", {**LAMP, "position": xyz(7.5, 0.8, 0.5)}),
        "objects[1].position: 'FloorLamp|3|7' lies outside",
    ),
    "thing under the floor": (
        set_at("objects", 0, "children", 0, "position", "y", -2.0),
        "objects[0].children[0].position: 'Apple|surface|2|0' lies outside",
    ),
    "object twice": (twice("objects"), "objects: id 'DiningTable|2|0' stands twice"),
    "child with its parent's id": (
        set_at("objects", 0, "children", 0, "id", "DiningTable|2|0"),
        "objects: id 'DiningTable|2|0' stands twice",
    ),
    "room twice": (twice("rooms"), "rooms: id 'room|2' stands twice"),
    "door twice": (twice("doors"), "doors: id 'door|2|3' stands twice"),
    "door to no room": (set_at("doors", 0, "room1", "room|9"), "doors[0].room1: no room 'room|9'"),
    "door in no wall": (set_at("doors", 0, "wall0", "wall|9"), "doors[0].wall0: no wall 'wall|9'"),
    "door without a hole": (
        set_at("doors", 0, "holePolygon", None),
        "doors[0]: neither holePolygon nor boundingBox",
    ),
    "hole without width": (
        set_at("doors", 0, "holePolygon", 1, "x", 1),
        "doors[0]: the hole has no width",
    ),
    "hole beside its wall": (
        set_at("doors", 0, "holePolygon", [xyz(7, 0, 0), xyz(8, 2, 0)]),
        "doors[0]: the hole lies outside its wall 'wall|2|",
    ),
    "wall of no room": (set_at("walls", 0, "roomId", "room|9"), "walls[0].roomId: no room"),
    "wall of two points": (
        set_at("walls", 3, "polygon", [xyz(0, 0, 0), xyz(4, 0, 0)]),
        "walls[3].polygon: 2 points",
    ),
    "wall without length": (
        set_at("walls", 3, "polygon", [xyz(0, y, 0) for y in (0, 1, 2, 2.5)]),
        "walls[3].polygon: the wall has no length",
    ),
    "not a number": (
        set_at("objects", 0, "position", "x", math.nan),
        "Expected `float` >= -1000.0 - at `$.objects[0].position.x`",
    ),
    "endless number": (
        set_at("walls", 1, "polygon", 2, "z", math.inf),
        "Expected `float` <= 1000.0 - at `$.walls[1].polygon[2].z`",
    ),
    "number without sense": (
        set_at("walls", 0, "polygon", 0, "x", 1e308),
        "Expected `float` <= 1000.0 - at `$.walls[0].polygon[0].x`",
    ),
    "nested too deep": (
        also("objects", nested(MOST_DEEP + 3)),
        f"more than {MOST_DEEP} things lie in one another",
    ),
    "nowhere to stand": (
        also("objects", {**LAMP, "id": "Bed|2|8", "assetId": "Vast_1", "position": xyz(4, 1, 2)}),
        "rooms: nowhere to stand",
    ),
}
VAST = {"Vast_1": {"boundingBox": xyz(20, 1, 20)}}


def test_the_house_is_whole_before_it_is_broken():
    assert len(house_scene(tiny_house(), name="tiny").rooms) == 2


@pytest.mark.parametrize("why", BROKEN)
def test_broken_house_is_refused_with_file_key_and_help(tmp_path, why):
    change, reason = BROKEN[why]
    house = tiny_house()
    change(house)
    path, assets = tmp_path / "house.json", tmp_path / "assets.json"
    path.write_text(json.dumps(house))
    assets.write_text(json.dumps(VAST))
    with pytest.raises(FileError) as caught:
        list(import_houses(path, assets=assets))
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in caught.value.reason
    assert "To fix: " in str(caught.value)


def test_deepest_nesting_allowed_is_read():
    house = tiny_house()
    house["objects"].append(nested(MOST_DEEP))
    boxes = [one for one in house_scene(house, name="tiny").objects if one.type == "Box"]
    assert len(boxes) == MOST_DEEP


def test_json_nested_beyond_any_stack_is_refused(tmp_path):
    path = tmp_path / "deep.json"
    path.write_text('{"rooms": ' + "[" * 200_000)
    with pytest.raises(FileError, match=r"deep\.json: "):
        list(import_houses(path))


@pytest.mark.parametrize("size", [xyz(1, 0, 1), xyz(1, -2, 1), xyz(1, 1, 900), xyz(1, math.nan, 1)])
def test_asset_without_a_size_is_refused(tmp_path, size):
    path, assets = tmp_path / "house.json", tmp_path / "assets.json"
    path.write_text(json.dumps(tiny_house()))
    assets.write_text(json.dumps({"Table_1": {"boundingBox": size}}))
    with pytest.raises(FileError, match="asset"):
        list(import_houses(path, assets=assets))


def test_line_of_a_broken_house_among_others_is_named(tmp_path):
    broken = tiny_house()
    broken["doors"][0]["room1"] = "room|9"
    path = tmp_path / "many.jsonl"
    path.write_text(f"{json.dumps(tiny_house())}\n{json.dumps(broken)}\n")
    with pytest.raises(FileError, match=r"line 2: doors\[0\]\.room1"):
        list(import_houses(path))


def test_command_says_what_is_wrong_in_one_line(tmp_path):
    house = tiny_house()
    house["objects"][0]["position"]["x"] = 99
    path = tmp_path / "house.json"
    path.write_text(json.dumps(house))
    result = CliRunner().invoke(app, ["world", "import", str(path), "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert "objects[0].position" in result.output
    assert "Traceback" not in result.output
