"""Houses of ProcTHOR's form become scenes in which one walks, picks up and puts down."""

import json
import math
from collections import Counter

import msgspec
import pytest
from support.paths import ROOT
from support.tiny_house import (
    ASSETS,
    BEDROOM,
    KITCHEN,
    ring,
    rooms_walked,
    tiny_house,
    wall,
    ways,
    xyz,
)
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.household.types import object_types
from karma.plugins.homes.houses import build_home, rooms_reached
from karma.plugins.thor_tools.importing.house_things import HouseAsset
from karma.plugins.thor_tools.importing.procthor import (
    holds_houses,
    house_scene,
    import_houses,
    read_assets,
)
from karma.world.core.navigate import interactable_poses
from karma.world.core.scene import SceneObject, load
from karma.world.core.thing import turned
from karma.world.sim import EmbeddedWorld

HOUSES = ROOT / "eval" / "lived" / "houses"
NAMES = [f"house_{number:02}" for number in range(1, 21)]


def known(table=ASSETS):
    return {name: msgspec.convert(row, HouseAsset) for name, row in table.items()}


def scene_of(house, **kind):
    return house_scene(house, name="tiny", assets=known(), **kind)


def of_type(scene, name):
    return [one for one in scene.objects if one.type == name]


@pytest.fixture(scope="module")
def houses():
    assets = HOUSES / "assets.json"
    return {n: next(iter(import_houses(HOUSES / f"{n}.json", assets=assets))) for n in NAMES}


# ----------------------------------------------------------------- the twenty houses


@pytest.mark.parametrize("name", NAMES)
def test_every_room_of_our_houses_is_reached_by_single_steps(houses, name):
    scene = houses[name]
    assert rooms_walked(EmbeddedWorld(scene), scene) == {room.name for room in scene.rooms}


@pytest.mark.parametrize("name", NAMES[::4])
def test_house_has_the_things_of_the_home_it_was_written_from(houses, name):
    scene = houses[name]
    home = build_home(len(scene.rooms), 16 + int(name[-2:]), name=name)
    kinds = {one.id: one.type for one in (*scene.objects, *home.objects)}

    def facts(objects):
        return sorted(
            (one.type, *(round(v, 2) + 0.0 for v in (*one.center, *one.size)), one.openness,
             one.is_toggled, one.is_dirty, len(one.controls),
             tuple(kinds[parent] for parent in one.parents))
            for one in objects if one.type != "Floor"
        )  # fmt: skip

    ours, theirs = facts(scene.objects), facts(home.objects)
    assert len(ours) == len(theirs)
    for mine, other in zip(ours, theirs, strict=True):
        assert (mine[0], mine[7:]) == (other[0], other[7:])
        assert mine[1:7] == pytest.approx(other[1:7], abs=0.011)
    assert set(home.reachable) <= set(scene.reachable)


@pytest.mark.parametrize("name", NAMES[::7])
def test_things_in_a_house_are_picked_up_and_put_elsewhere(houses, name):
    world = EmbeddedWorld(houses[name])
    done = 0
    for thing in houses[name].objects:
        if "pickupable" not in thing.capabilities or done == 3:
            continue
        place = another_place(world, thing)
        if place is None or not go_to(world, thing.id):
            continue
        assert world.step("PickupObject", objectId=thing.id)
        assert go_to(world, place.id)
        put = world.step("PutObject", objectId=place.id)
        assert put, put.metadata["errorMessage"]
        assert world.state.objects[thing.id].parents[0] == place.id
        done += 1
    assert done == 3


def another_place(world, thing):
    kinds = object_types()
    for one in world.state.objects.values():
        takes = one.type in ("DiningTable", "Desk", "CounterTop", "Bed", "CoffeeTable")
        if takes and kinds[thing.type].fits(kinds[one.type]) and one.id not in thing.parents:
            return one
    return None


def go_to(world, object_id):
    poses = interactable_poses(world.state, object_id, limit=1)
    if not poses:
        return False
    pose = poses[0]
    return world.step(
        "TeleportFull", position=xyz(*pose.position_m), rotation=xyz(0, pose.yaw_deg, 0),
        horizon=pose.horizon_deg, standing=pose.standing,
    )  # fmt: skip


# ----------------------------------------------------------------- floor


def apart(p, a, b):
    """Return the distance of a point from a line between two others."""
    square = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    share = ((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / square
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))


def test_cells_are_those_that_a_body_fits_on():
    scene = scene_of(tiny_house())
    edges = [(c, d) for p in (KITCHEN, BEDROOM) for c, d in zip(p, (*p[1:], p[0]), strict=True)]
    edges = [edge for edge in edges if {x for x, _ in edge} != {4}]
    edges += [((4, 0), (4, 2)), ((4, 3), (4, 4))]  # the door is from z = 2 to 3
    expected = set()
    for i in range(33):
        for j in range(17):
            x, z = i / 4, j / 4
            in_some = (x < 4 or z >= 0) and (x <= 6 or z >= 2)
            table = math.hypot(max(abs(x - 1.5) - 0.6, 0), max(abs(z - 1.5) - 0.4, 0))
            if in_some and table >= 0.2 and all(apart((x, z), a, b) >= 0.2 for a, b in edges):
                expected.add((x, z))
    assert set(scene.reachable) == expected
    assert len(ways(scene)) == len(expected)


def test_older_schema_says_the_same_of_a_hole():
    house = tiny_house()
    low, high = house["doors"][0].pop("holePolygon")
    house["doors"][0]["boundingBox"] = {"min": low, "max": high}
    house["metadata"]["schema"] = "0.0.1"
    old, new = scene_of(house), scene_of(tiny_house())
    assert (old.reachable, old.walls) == (new.reachable, new.walls)


def test_door_of_the_house_is_no_passage():
    house = tiny_house()
    house["walls"].append(wall("exterior", (0, 4), (0, 0)))
    house["doors"].append({
        "id": "door|1|2", "room0": "room|2", "room1": "room|2",
        "wall0": "wall|2|0.00|0.00|0.00|4.00", "wall1": house["walls"][-1]["id"],
        "holePolygon": [xyz(1, 0, 0), xyz(2, 2, 0)], "openable": False, "openness": 0,
    })  # fmt: skip
    scene = scene_of(house)
    assert (scene.reachable, scene.walls) == tuple(
        getattr(scene_of(tiny_house()), field) for field in ("reachable", "walls")
    )
    assert "shut" not in scene.source


def test_empty_wall_joins_rooms():
    house = tiny_house()
    house["doors"] = []
    for one in house["walls"]:
        one["empty"] = one["id"].endswith("|4.00|0.00|4.00|4.00")
    scene = scene_of(house)
    assert rooms_reached(scene) == {"kitchen_1", "bedroom_1"}
    assert {(4.0, z / 4) for z in range(1, 16)} <= set(scene.reachable)


def test_room_that_nobody_can_walk_to_is_said():
    house = tiny_house()
    house["doors"] = []
    scene = scene_of(house)
    assert "nobody can walk to" in scene.source
    assert len(rooms_reached(scene)) == 1


def test_slanting_wall_keeps_the_body_off():
    house = tiny_house()
    corners = ((4, 0), (4, 4), (8, 4), (8, 2), (6, 0))
    house["rooms"][1]["floorPolygon"] = [xyz(x, 0, z) for x, z in corners]
    house["walls"] = [*ring(2, KITCHEN), *ring(3, corners)]
    scene = scene_of(house)
    slant = [cell for cell in scene.reachable if cell[0] > 4.2]
    assert min(apart(cell, (8, 2), (6, 0)) for cell in slant) >= 0.2 - 1e-6
    assert min(apart(cell, (8, 2), (6, 0)) for cell in slant) < 0.45
    pieces = [one for one in scene.walls if one.low[0] > 6 - 0.1 and one.high[2] < 2 + 0.1]
    assert len(pieces) > 20
    assert all(max(one.high[0] - one.low[0], one.high[2] - one.low[2]) < 0.15 for one in pieces)


def test_wall_hides_and_doorway_shows():
    house = tiny_house()
    ball = {"id": "BasketBall|surface|3|0", "position": xyz(5, 0.12, 2.5)}
    house["objects"].append(ball)
    world = EmbeddedWorld(scene_of(house), visibilityDistance=5.0)
    [the_ball] = [one for one in world.state.objects.values() if one.type == "BasketBall"]

    def seen(z):
        where = xyz(3.0, 0.9, z)
        rotation = xyz(0, 90, 0)
        event = world.step(
            "TeleportFull", position=where, rotation=rotation, horizon=0, standing=True
        )
        assert event
        return the_ball.id in world.state.sight.visible

    assert seen(2.5)
    assert not seen(0.5)


# ----------------------------------------------------------------- things


def test_things_lie_where_they_are_written():
    scene = scene_of(tiny_house())
    [table] = of_type(scene, "DiningTable")
    [apple] = of_type(scene, "Apple")
    assert (table.size, table.center) == ((1.2, 0.8, 0.8), (1.5, 0.4, 1.5))
    assert table.parents == (of_type(scene, "Floor")[0].id,)
    assert apple.parents == (table.id,)
    assert apple.size == object_types()["Apple"].size_m
    assert (apple.id, apple.name) == ("Apple|surface|2|0", "Apple|surface|2|0")
    assert "2 things have their type's usual size" in scene.source


def test_what_we_have_no_type_for_is_left_out_with_its_contents_and_counted():
    house = tiny_house()
    house["objects"] += [
        {"id": "Wardrobe|3|1", "position": xyz(5, 1, 1), "children": [
            {"id": "Book|surface|3|9", "position": xyz(5, 1, 1)}]},
        {"id": "Wardrobe|3|2", "position": xyz(5, 1, 2)},
    ]  # fmt: skip
    scene = scene_of(house)
    assert "left out 2 of types that we do not have: Wardrobe 2" in scene.source
    assert "left out 1 that lay in or on those" in scene.source
    assert Counter(one.type for one in scene.objects) == Counter(
        one.type for one in scene_of(tiny_house()).objects
    )


@pytest.mark.parametrize("yaw", [0, 30, 90, 135, 180, 270, 359])
def test_turned_thing_has_the_box_round_it(yaw):
    house = tiny_house()
    house["objects"][0]["rotation"]["y"] = yaw
    [table] = of_type(scene_of(house), "DiningTable")
    half = (0.6, 0.4, 0.4)
    upright = SceneObject(
        id="t", type="DiningTable", name="t", position=(1.5, 0.4, 1.5), center=(1.5, 0.4, 1.5),
        size=(1.2, 0.8, 0.8),
        corners=tuple((1.5 + a * half[0], 0.4 + b * half[1], 1.5 + c * half[2])
                      for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)),
    )  # fmt: skip
    expected = turned(upright, yaw, upright.center)
    assert table.size == pytest.approx(expected.size, abs=1e-3)
    assert (table.corners is None) == (yaw % 90 == 0)
    if table.corners is not None:
        ours, theirs = (
            {tuple(round(v, 3) for v in c) for c in t.corners} for t in (table, expected)
        )
        assert ours == theirs


def test_states_are_kept_and_knobs_control_burners():
    house = tiny_house()
    house["objects"] += [
        {"id": "Box|3|1", "position": xyz(5, 0.2, 3), "openness": 0},
        {"id": "FloorLamp|3|2", "position": xyz(5, 0.8, 3.6), "isOn": False},
        {"id": "Bed|3|3", "position": xyz(7, 0.3, 3), "isDirty": True, "kinematic": True},
        *({"id": f"StoveBurner|2|{n}", "position": xyz(0.5, 0.9, n / 2)} for n in (2, 3)),
        *({"id": f"StoveKnob|2|{n}", "position": xyz(0.8, 0.8, n / 2)} for n in (2, 3)),
    ]
    scene = scene_of(house)
    [box], [lamp], [bed] = (of_type(scene, kind) for kind in ("Box", "FloorLamp", "Bed"))
    assert (box.openness, lamp.is_toggled, bed.is_dirty) == (0.0, False, True)
    assert "moveable" not in bed.capabilities
    burners = [one.id for one in of_type(scene, "StoveBurner")]
    assert [knob.controls for knob in of_type(scene, "StoveKnob")] == [(one,) for one in burners]


# ----------------------------------------------------------------- files


def test_file_of_several_houses_names_each(tmp_path):
    path = tmp_path / "val.jsonl"
    path.write_text(f"{json.dumps(tiny_house())}\n" * 3)
    assert holds_houses(path)
    assert [one.name for one in import_houses(path)] == ["val_1", "val_2", "val_3"]
    assert [one.name for one in import_houses(path, only=["val_2"])] == ["val_2"]
    with pytest.raises(FileError, match="no house named 'val_9' among 3"):
        list(import_houses(path, only=["val_9"]))


def test_database_of_assets_is_read_in_both_forms(tmp_path):
    box = {"boundingBox": xyz(1, 2, 3), "objectType": "Bed", "assetId": "Bed_7"}
    for content in ({"Bed": [box]}, {"Bed_7": box}):
        path = tmp_path / "assets.json"
        path.write_text(json.dumps(content))
        assert read_assets(path)["Bed_7"].bounding_box.tuple == (1, 2, 3)
    for content in ({"Bed": [{"boundingBox": xyz(1, 2, 3)}]}, {"Bed_7": {"boundingBox": 3}}):
        path.write_text(json.dumps(content))
        with pytest.raises(FileError, match="Bed"):
            read_assets(path)


def test_command_knows_a_house_by_its_keys(tmp_path):
    house, assets = HOUSES / "house_01.json", HOUSES / "assets.json"
    arguments = ["world", "import", str(house), "--assets", str(assets), "--out", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "1 scenes in" in result.output
    assert len(load(tmp_path / "house_01.json").rooms) == 2
