"""A house that contradicts itself is refused; file, key and what is wrong there are named."""

import copy
import json
import math

import pytest
from support.tiny_house import tiny_house, xyz
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.plugins.thor_tools.importing.procthor import house_scene, import_houses


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
    "word for a number": (set_at("walls", 2, "polygon", 0, "x", "left"), "$.walls[2].polygon[0].x"),
    "other kind of room": (set_at("rooms", 0, "roomType", "Attic"), "'Attic' - at `$.rooms[0]"),
    "no rooms": (set_at("rooms", []), "rooms: there are none"),
    "floor of two points": (
        set_at("rooms", 1, "floorPolygon", [xyz(4, 0, 0), xyz(8, 0, 4)]),
        "rooms[1].floorPolygon: the floor's area",
    ),
    "floor without area": (
        set_at("rooms", 1, "floorPolygon", [xyz(4, 0, 0), xyz(6, 0, 2), xyz(8, 0, 4)]),
        "rooms[1].floorPolygon: the floor's area",
    ),
    "upper floor": (
        set_at("rooms", 1, "floorPolygon", 2, "y", 3.0),
        "rooms[1].floorPolygon: not level",
    ),
    "other schema": (set_at("metadata", "schema", "7.0.0"), "metadata.schema: '7.0.0'"),
    "thing outside": (
        also("objects", {**LAMP, "position": xyz(50, 0.8, 3)}),
        "objects[1].position: 'FloorLamp|3|7' lies outside the house",
    ),
    "thing under the floor": (
        set_at("objects", 0, "children", 0, "position", "y", -2.0),
        "objects[0].children[0].position: 'Apple|surface|2|0' lies outside",
    ),
    "object twice": (twice("objects"), "objects: id 'DiningTable|2|0' stands twice"),
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
    "wall without length": (
        set_at("walls", 3, "polygon", [xyz(0, y, 0) for y in (0, 1, 2, 2.5)]),
        "walls[3].polygon: the wall has no length or height",
    ),
    "not a number": (
        set_at("objects", 0, "position", "x", math.nan),
        "Expected `float` >= -1000.0 - at `$.objects[0].position.x`",
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


def test_command_says_what_is_wrong_in_one_line(tmp_path):
    house = tiny_house()
    house["objects"][0]["position"]["x"] = 99
    path = tmp_path / "house.json"
    path.write_text(json.dumps(house))
    result = CliRunner().invoke(app, ["world", "import", str(path), "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert "objects[0].position" in result.output
    assert "Traceback" not in result.output
