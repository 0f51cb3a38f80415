"""Our own rooms are whole, plausible and the same on every machine."""

import os
import re
import subprocess
import sys
from decimal import Decimal
from itertools import combinations

import pytest
from support.paths import ROOT

from karma.errors import FileError, KarmaError
from karma.files import to_json
from karma.household.types import object_type
from karma.plugins.rooms import generate
from karma.plugins.rooms.furnish import NoRoomError
from karma.plugins.rooms.generate import build_scene, object_id
from karma.plugins.rooms.rooms import TABLE, rooms
from karma.world.core.boxes import Box
from karma.world.core.scene import SCENES, load

NAMES = sorted(path.stem for path in SCENES.glob("*.json"))
KINDS = ("bathroom", "bedroom", "kitchen", "living")
COUNTS = {"kitchen": (40, 80), "living": (25, 50), "bedroom": (25, 50), "bathroom": (25, 50)}
NEEDED = {
    "kitchen": """StoveBurner StoveKnob Sink SinkBasin Faucet CounterTop Fridge Microwave Toaster
        CoffeeMachine Cabinet Drawer GarbageCan DiningTable Chair Shelf Window LightSwitch Floor
        Apple Tomato Potato Lettuce Bread Egg Knife ButterKnife Fork Spoon Spatula Plate Bowl Mug
        Cup Pan Pot SaltShaker PepperShaker DishSponge SoapBottle PaperTowelRoll""",
    "living": """Sofa ArmChair CoffeeTable TVStand Television SideTable FloorLamp DeskLamp Box
        Laptop RemoteControl Book Vase Statue Pillow KeyChain CreditCard Window LightSwitch
        GarbageCan HousePlant Painting Drawer Floor""",
    "bedroom": """Bed Dresser Drawer Desk SideTable AlarmClock Laptop CD Book Pen Pencil CellPhone
        Pillow KeyChain CreditCard Mirror Window LightSwitch GarbageCan DeskLamp Shelf Floor""",
    "bathroom": """Sink SinkBasin Faucet Toilet Bathtub BathtubBasin ShowerHead ShowerCurtain
        TowelHolder Towel HandTowelHolder HandTowel ToiletPaperHanger ToiletPaper SoapBar
        SoapBottle Candle SprayBottle Cloth Plunger ScrubBrush GarbageCan Cabinet Drawer Shelf
        Mirror LightSwitch CounterTop Floor""",
}
SOMEWHERE = {
    "kitchen": {"Kettle", "Ladle", "WineBottle", "Bottle", "SideTable"},
    "living": {"Desk", "Newspaper", "Watch", "DiningTable", "Chair", "Shelf", "ShelvingUnit",
               "Ottoman", "Dresser", "CellPhone", "Candle"},
    "bedroom": {"TeddyBear", "BaseballBat", "BasketBall", "LaundryHamper", "TennisRacket",
                "ArmChair", "Mug", "Safe", "ShelvingUnit"},
    "bathroom": {"TissueBox", "SideTable"},
}  # fmt: skip
HANGERS = {"TowelHolder", "HandTowelHolder", "ToiletPaperHanger"}
scenes = pytest.mark.parametrize("name", NAMES)


def box(thing):
    return Box.around(thing.center, thing.size)


def things(scene):
    return [one for one in scene.objects if "pickupable" in one.capabilities]


def kind_of(name):
    return name.rsplit("_", 1)[0]


@scenes
def test_scene_loads_with_what_its_room_needs(name):
    scene = load(name)
    kind = kind_of(name)
    assert scene.name == name
    assert scene.room == rooms().kinds[kind].room
    assert COUNTS[kind][0] <= len(scene.objects) <= COUNTS[kind][1]
    missing = set(NEEDED[kind].split()) - {one.type for one in scene.objects}
    assert not missing
    assert (SCENES / f"{name}.json").stat().st_size < 60_000


@pytest.mark.parametrize("kind", KINDS)
def test_scenes_optional_types_appear_somewhere(kind):
    found = {one.type for name in NAMES if kind_of(name) == kind for one in load(name).objects}
    assert found >= SOMEWHERE[kind]


@scenes
def test_scene_ids_are_unique_and_follow_the_rounding_rule(name):
    scene = load(name)
    assert len({one.id for one in scene.objects}) == len(scene.objects)
    assert len({one.name for one in scene.objects}) == len(scene.objects)
    by_id = {one.id: one for one in scene.objects}
    for one in scene.objects:
        assert re.fullmatch(rf"{one.type}_[0-9a-f]{{8}}", one.name)
        if one.id.count("|") == 4:
            parent, child = one.id.rsplit("|", 1)
            assert child == one.type
            assert by_id[parent].type in ("Sink", "Bathtub")
            assert box(by_id[parent]).grown(0, 0.01, 0).overlaps(box(one))
            continue
        said = one.id.split("|")
        assert said[0] == one.type
        for text, value in zip(said[1:], one.position, strict=True):
            assert re.fullmatch(r"[+-]\d\d\.\d\d|00\.00", text)
            assert abs(Decimal(text) - Decimal(str(value))) <= Decimal("0.005")
            assert (text[0] == "+") == (value >= 0)


@scenes
def test_scene_movables_do_not_overlap(name):
    for one, other in combinations(things(load(name)), 2):
        assert not box(one).overlaps(box(other), slack=1e-4), (one.id, other.id)


@scenes
def test_scene_furniture_overlaps_only_within_one_piece(name):
    """Parts of a piece may enclose each other (drawer and dresser, basin and sink)."""
    pairs = {("Drawer", "Dresser"), ("Drawer", "Desk"), ("Drawer", "SideTable"),
             ("Drawer", "TVStand"), ("SinkBasin", "Sink"), ("BathtubBasin", "Bathtub"),
             ("ShowerCurtain", "Bathtub"), ("StoveKnob", "StoveBurner")}  # fmt: skip
    fixed = [one for one in load(name).objects if "pickupable" not in one.capabilities]
    for one, other in combinations(fixed, 2):
        if box(one).overlaps(box(other), slack=1e-3):
            assert {(one.type, other.type), (other.type, one.type)} & pairs, (one.id, other.id)


@scenes
def test_scene_everything_is_inside_the_walls(name):
    scene = load(name)
    room = Box.around(scene.bounds_center, scene.bounds_size).grown(1e-3, 1e-3, 1e-3)
    for one in scene.objects:
        if one.type != "Floor":
            low, high = box(one)[:3], box(one)[3:]
            assert all(a <= b for a, b in zip(room[:3], low, strict=True)), one.id
            assert all(a >= b for a, b in zip(room[3:], high, strict=True)), one.id


@scenes
def test_scene_movables_rest_on_or_in_a_receptacle_they_fit(name):
    scene = load(name)
    by_id = {one.id: one for one in scene.objects}
    for one in things(scene):
        (parent,) = (by_id[parent] for parent in one.parents)
        assert "receptacle" in parent.capabilities
        assert object_type(one.type).fits(object_type(parent.type)), (one.id, parent.id)
        inner, outer = box(one), box(parent)
        assert outer.y0 - 1e-3 <= inner.y0 <= outer.y1 + 1e-3 or parent.type in HANGERS
        if object_type(parent.type).must_be_open:
            assert all(a >= b for a, b in zip(inner[:3], outer[:3], strict=True)), one.id
            assert all(a <= b for a, b in zip(inner[3:], outer[3:], strict=True)), one.id


@scenes
def test_scene_cells_are_free_connected_and_hold_the_agent(name):
    scene = load(name)
    cells = set(scene.reachable)
    assert list(scene.reachable) == sorted(cells)
    x, y, z = scene.agent.position
    assert (x, z) in cells
    assert y == pytest.approx(scene.floor_y + 0.9)
    room = Box.around(scene.bounds_center, scene.bounds_size)
    low = [
        one for one in scene.objects
        if one.type != "Floor" and box(one).y0 < 0.5
        and ("pickupable" not in one.capabilities or one.parents[0].startswith("Floor"))
    ]  # fmt: skip
    for cell_x, cell_z in cells:
        assert cell_x % scene.grid_m == cell_z % scene.grid_m == 0
        assert min(cell_x - room.x0, room.x1 - cell_x, cell_z - room.z0, room.z1 - cell_z) >= 0.2
        assert all(box(one).distance(cell_x, box(one).y0, cell_z) >= 0.2 - 1e-4 for one in low)
    seen, queue = {(x, z)}, [(x, z)]
    while queue:
        a, b = queue.pop()
        for step in ((a + 0.25, b), (a - 0.25, b), (a, b + 0.25), (a, b - 0.25)):
            if step in cells - seen:
                seen.add(step)
                queue.append(step)
    assert seen == cells


@scenes
def test_scene_receptacles_and_movables_are_in_reach(name):
    scene = load(name)
    used = [one for one in scene.objects if {"receptacle", "pickupable"} & set(one.capabilities)]
    for one in used:
        b = box(one)
        assert min(b.distance(x, b.y0, z) for x, z in scene.reachable) <= 1.5, one.id


@scenes
def test_scene_states_follow_from_the_place(name):
    scene = load(name)
    by_id = {one.id: one for one in scene.objects}
    for one in scene.objects:
        cold = any("isColdSource" in by_id[parent].capabilities for parent in one.parents)
        assert one.temperature == ("Cold" if cold else "RoomTemp")
        assert not one.is_dirty or "dirtyable" in one.capabilities
        assert not one.is_filled or "canFillWithLiquid" in one.capabilities
        assert not one.is_toggled or "toggleable" in one.capabilities
        assert not one.openness or "openable" in one.capabilities
    knobs = [one for one in scene.objects if one.type == "StoveKnob"]
    burners = {one.id for one in scene.objects if one.type == "StoveBurner"}
    assert {controlled for knob in knobs for controlled in knob.controls} == burners


def test_scenes_some_kitchens_have_duplicates_of_which_one_is_dirty():
    found = 0
    for number in range(1, 5):
        for kind in ("Plate", "Bowl", "Mug", "Cup"):
            same = [one for one in load(f"kitchen_{number}").objects if one.type == kind]
            found += {one.is_dirty for one in same} == {True, False}
    assert found


@scenes
def test_scene_equals_what_its_seed_draws(name):
    kind, number = name.rsplit("_", 1)
    path = SCENES / f"{name}.json"
    seed = int(load(name).source.rsplit(" ", 1)[1])
    assert to_json(build_scene(kind, int(number), seed)) == path.read_bytes()


def test_make_scenes_under_another_hash_seed_gives_equal_bytes(tmp_path):
    script = ROOT / "scripts/make_scenes.py"
    command = [sys.executable, str(script), "--seed", "29", "--out", str(tmp_path)]
    env = {**os.environ, "PYTHONHASHSEED": "1"}
    subprocess.run(command, check=True, capture_output=True, env=env)
    for name in NAMES:
        assert (tmp_path / f"{name}.json").read_bytes() == (SCENES / f"{name}.json").read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_build_scene_other_seeds_give_other_rooms_that_hold(kind):
    drawn = [build_scene(kind, 1, seed) for seed in (1, 2, 3)]
    assert len({to_json(scene.objects) for scene in drawn}) == 3
    for scene in drawn:
        assert set(NEEDED[kind].split()) <= {one.type for one in scene.objects}
        for one, other in combinations(things(scene), 2):
            assert not box(one).overlaps(box(other), slack=1e-4)


def test_build_scene_without_a_draw_that_works_gives_up(monkeypatch):
    def never(*_):
        raise NoRoomError("never")

    monkeypatch.setattr(generate, "_draw", never)
    with pytest.raises(KarmaError, match="kitchen_1 with seed 7"):
        build_scene("kitchen", 1, 7)


@pytest.mark.parametrize(
    ("position", "said"),
    [((0.0, 1.154, -0.004), "+00.00|+01.15|00.00"), ((-0.006, -12.5, 3.999),
      "-00.01|-12.50|+04.00"),
     ((-0.0, 0.004, 10.0), "+00.00|+00.00|+10.00")],
)  # fmt: skip
def test_object_id_signs_and_rounds_as_ai2thor(position, said):
    assert object_id("Cup", position) == f"Cup|{said}"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [('piece = "table"', 'piece = "tabel"', "'tabel'"),
     ("\nApple =", "\nAple =", "'Aple'"),
     ("Towel = { in = { TowelHolder = 1 } }", "Towel = { in = { Microwave = 1 } }", "Microwave"),
     ("height = 2.6", 'height = "high"', "height"),
     ("height = 2.6", "hight = 2.6", "hight")],
)  # fmt: skip
def test_rooms_damaged_table_says_where(tmp_path, monkeypatch, old, new, said):
    path = tmp_path / "rooms.toml"
    path.write_text(TABLE.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    monkeypatch.setattr("karma.plugins.rooms.rooms.TABLE", path)
    with pytest.raises(FileError, match=said) as caught:
        rooms.__wrapped__()
    assert caught.value.path == path
