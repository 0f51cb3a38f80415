"""What happens in the household, one test per rule; and what is seen, against recorded scenes.

Every effect of `rules.toml` has a test: `test_table_has_no_effect_without_a_test` counts them.
"""

import math
from itertools import islice

import msgspec
import numpy as np
import pytest
from support.floor_plans import recorded_rooms
from support.household import bring, find, kitchen, look, on, reach, thing

from karma.types.space import Pose
from karma.world.core.hiding import holes
from karma.world.core.objects import Objects
from karma.world.core.rules import rules
from karma.world.core.view import sight
from karma.world.sim import EmbeddedWorld


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


def switch(world, kind, on=True, *, force=False):
    object_id = find(world, kind) if force else reach(world, kind)
    action = "ToggleObjectOn" if on else "ToggleObjectOff"
    return world.step(action, objectId=object_id, forceAction=force)


def cut(world, kind):
    assert world.step("SliceObject", objectId=find(world, kind), forceAction=True)


def with_extra(*extra):
    return EmbeddedWorld(kitchen(extra))


# ----------------------------------------------------------------- effects

PAN = "bring Potato Pan, bring Pan StoveBurner"
OVEN = "open Microwave, bring {0} Microwave, close Microwave, on Microwave"
EFFECTS = [  # effects of the table, what is done, and the states after it
    ("a lit burner heats what stands on it", f"{PAN}, on StoveKnob", "Pan", {"temperature": "Hot"}),
    ("a lit burner cooks", f"{PAN}, on StoveKnob", "Potato",
     {"temperature": "Hot", "isCooked": True}),
    ("a lit burner cooks", "open Fridge, cut Egg, bring EggCracked Pan, bring Pan StoveBurner, "
     "on StoveKnob", "EggCracked", {"isCooked": True}),
    ("", "bring Apple Pan, bring Pan StoveBurner, on StoveKnob", "Apple", {"isCooked": False}),
    ("", PAN, "Potato", {"isCooked": False}),
    ("a running microwave heats", OVEN.format("Mug"), "Mug",
     {"temperature": "Hot", "isCooked": False}),
    ("a running microwave cooks, but does not toast", f"cut Potato, {OVEN.format('PotatoSliced')}",
     "PotatoSliced", {"temperature": "Hot", "isCooked": True}),
    ("", f"cut Bread, {OVEN.format('BreadSliced')}", "BreadSliced", {"isCooked": False}),
    ("a toaster heats", "cut Bread, on Toaster, bring BreadSliced Toaster", "BreadSliced",
     {"temperature": "Hot"}),
    ("a toaster toasts bread", "cut Bread, bring BreadSliced Toaster, on Toaster", "BreadSliced",
     {"isCooked": True}),
    ("", "cut Bread, bring BreadSliced Toaster", "BreadSliced", {"isCooked": False}),
    ("a fridge cools, open or closed", "open Fridge, bring Apple Fridge, pick Apple", "Apple",
     {"temperature": "Cold"}),
    ("running water fills what is empty", "bring Mug SinkBasin, on Faucet", "Mug",
     {"isFilledWithLiquid": True, "fillLiquid": "water"}),
    ("running water cleans", "bring Mug SinkBasin, dirty Mug, on Faucet", "Mug",
     {"isDirty": False}),
    ("running water puts a candle out", "bring Candle SinkBasin, on Faucet", "Candle",
     {"isToggled": False}),
    ("", "bring Mug SinkBasin, on Faucet", "Plate", {"isDirty": True}),
    ("", "pour Mug, bring Mug SinkBasin, on Faucet", "Mug", {"fillLiquid": "wine"}),
    ("a coffee machine fills an empty mug", "bring Mug CoffeeMachine, on CoffeeMachine", "Mug",
     {"fillLiquid": "coffee"}),
    ("a coffee machine keeps its mug hot", "bring Mug CoffeeMachine, on CoffeeMachine", "Mug",
     {"temperature": "Hot"}),
]  # fmt: skip
ACTIONS = {"open": "OpenObject", "close": "CloseObject", "cut": "SliceObject",
           "dirty": "DirtyObject", "pick": "PickupObject"}  # fmt: skip


def run(world, program):
    """Do the steps of a short program; returns the ids of what was brought, by type."""
    for line in program.split(", "):
        verb, kind, *place = line.split()
        if verb == "bring":
            event = bring(world, kind, *place, force=True)[0]
        elif verb == "on":
            event = switch(world, kind, force=True)
        elif verb == "pour":
            event = world.step("FillObjectWithLiquid", objectId=find(world, kind),
                               fillLiquid="wine", forceAction=True)  # fmt: skip
        else:
            event = world.step(ACTIONS[verb], objectId=find(world, kind), forceAction=True)
        assert event, (line, event.message)


def test_table_has_no_effect_without_a_test():
    assert {effect.name for effect in rules().effect} == {name for name, *_ in EFFECTS if name}


@pytest.mark.parametrize(("program", "kind", "states"), [row[1:] for row in EFFECTS])
def test_effect(world, program, kind, states):
    run(world, program)
    assert {key: look(world, find(world, kind))[key] for key in states} == states


def test_thing_in_a_pan_on_a_burner_lies_on_both(world):
    run(world, PAN)
    pan, burner = find(world, "Pan"), look(world, find(world, "Pan"))["parentReceptacles"]
    assert look(world, find(world, "Potato"))["parentReceptacles"] == [pan, *burner]


def test_cooked_potato_gives_cooked_slices(world):
    world.step("CookObject", objectId=find(world, "Potato"), forceAction=True)
    cut(world, "Potato")
    assert look(world, find(world, "PotatoSliced"))["isCooked"]


def test_microwave_runs_closed_and_opens_off(world):
    microwave = reach(world, "Microwave")
    world.step("OpenObject", objectId=microwave)
    assert switch(world, "Microwave").message == "Target must be closed to Toggle On!"
    world.step("CloseObject", objectId=microwave)
    assert switch(world, "Microwave")
    refused = world.step("OpenObject", objectId=microwave)
    assert refused.message == "Target must be OFF to open!"
    switch(world, "Microwave", False)
    assert world.step("OpenObject", objectId=microwave)


def test_toaster_takes_one_slice_of_bread_and_nothing_else(world):
    cut(world, "Bread")
    assert bring(world, "BreadSliced", "Toaster")[0]
    slices = [i for i, t in world.state.objects.items() if t.type == "BreadSliced" and t.parents]
    second = next(i for i in slices if "Toaster" not in world.state.objects[i].parents[0])
    world.step("PickupObject", objectId=second, forceAction=True)
    full = world.step("PutObject", objectId=find(world, "Toaster"), forceAction=True)
    assert full.message == "No valid positions to place object found"
    world.step("DropHeldObject")
    event, _, _ = bring(world, "Apple", "Toaster", force=True)
    assert "cannot be placed in" in event.message


# ----------------------------------------------------------------- decay


def test_heat_runs_out_after_the_decay_time(world):
    mug = find(world, "Mug")
    world.step("FillObjectWithLiquid", objectId=mug, fillLiquid="coffee", forceAction=True)
    lasted = 0
    while look(world, mug)["temperature"] == "Hot":
        world.step("Pass")
        lasted += 1
    assert lasted == pytest.approx(rules().time.decay_s / rules().time.action_s, abs=1)
    assert look(world, mug)["fillLiquid"] == "coffee"


def test_heat_does_not_run_out_in_a_zone_nor_while_only_questions_are_asked(world):
    egg = find(world, "Egg")
    for _ in range(round(rules().time.decay_s / rules().time.action_s) + 5):
        world.step("Pass")
    assert look(world, egg)["temperature"] == "Cold"
    time = world.last_event.metadata["currentTime"]
    world.step("GetReachablePositions")
    world.step("PickupObject", objectId="nothing")
    assert world.last_event.metadata["currentTime"] == time


def test_heat_left_of_a_scene_file_runs_out():
    hot = thing("Pot", (-1.0, 0.95, 0.95), (0.1, 0.1, 0.1), temperature="Hot", heat_left_s=0.1)
    world = with_extra(hot)
    assert look(world, hot.id)["temperature"] == "Hot"
    for _ in range(3):
        world.step("Pass")
    assert look(world, hot.id)["temperature"] == "RoomTemp"


def test_liquid_is_filled_once_and_emptied_once(world):
    mug = reach(world, "Mug")
    assert not world.step("EmptyLiquidFromObject", objectId=mug)
    assert not world.step("FillObjectWithLiquid", objectId=mug, fillLiquid="tea")
    assert world.step("FillObjectWithLiquid", objectId=mug, fillLiquid="water")
    assert not world.step("FillObjectWithLiquid", objectId=mug, fillLiquid="water")
    assert world.step("EmptyLiquidFromObject", objectId=mug)
    assert look(world, mug)["fillLiquid"] is None


# ----------------------------------------------------------------- slicing and breaking


def test_slicing_keeps_the_source_inert_and_makes_slices_in_its_place(world):
    apple = reach(world, "Apple")
    table = look(world, apple)["parentReceptacles"]
    assert world.step("SliceObject", objectId=apple)
    slices = [o for o in world.last_event.objects if o["objectType"] == "AppleSliced"]
    assert [o["objectId"] for o in slices] == [f"{apple}|AppleSliced_{i}" for i in range(3)]
    assert all(o["parentReceptacles"] == table and o["pickupable"] for o in slices)
    assert look(world, apple)["isSliced"]
    assert not look(world, apple)["visible"]
    assert not world.step("PickupObject", objectId=apple, forceAction=True)
    assert world.step("SliceObject", objectId=apple)  # a second time: silently nothing
    assert len(world.last_event.objects) == len(kitchen().objects) + 3


@pytest.mark.parametrize("action", ["SliceObject", "BreakObject"])
def test_egg_becomes_a_cracked_egg(world, action):
    world.step("OpenObject", objectId=reach(world, "Fridge"))
    egg = reach(world, "Egg")
    assert world.step(action, objectId=egg)
    cracked = look(world, f"{egg}|EggCracked_0")
    assert cracked["temperature"] == "Cold"
    assert cracked["cookable"]
    assert not look(world, egg)["visible"]


def test_broken_plate_loses_what_lies_on_it_and_the_hand_loses_the_plate(world):
    plate = reach(world, "Plate")
    world.step("PickupObject", objectId=plate)
    assert world.step("BreakObject", objectId=plate)
    assert look(world, plate)["isBroken"]
    assert world.last_event.metadata["inventoryObjects"] == []
    assert look(world, find(world, "Tomato"))["parentReceptacles"] == [find(world, "Floor")]
    assert not world.step("BreakObject", objectId=plate)


def test_broken_screen_goes_off_and_cannot_be_switched_on(world):
    phone = reach(world, "CellPhone")
    world.step("BreakObject", objectId=phone)
    assert not look(world, phone)["isToggled"]
    assert "broken" in world.step("ToggleObjectOn", objectId=phone).message


@pytest.mark.parametrize(("force", "broken"), [(10.0, False), (150.0, True)])
def test_throwing_hard_breaks_and_throwing_softly_does_not(world, force, broken):
    mug = reach(world, "Mug")
    world.step("PickupObject", objectId=mug)
    world.step("RotateRight", degrees=180)
    event = world.step("ThrowObject", moveMagnitude=force)
    assert event
    assert event.metadata["actionReturn"] == look(world, mug)["position"]
    assert look(world, mug)["isBroken"] is broken
    lies = None if broken else [find(world, "Floor")]  # of a broken mug only the id is left
    assert look(world, mug)["parentReceptacles"] == lies
    assert not (broken and look(world, mug)["visible"])


def test_dropping_onto_a_table_leaves_the_thing_there(world):
    apple = reach(world, "Apple")
    world.step("PickupObject", objectId=apple)
    world.step("TeleportFull", x=1.0, y=0.9, z=-0.5, rotation=90, horizon=0, standing=True)
    assert world.step("DropHeldObject")
    assert look(world, apple)["parentReceptacles"] == [find(world, "DiningTable")]
    assert look(world, apple)["position"]["y"] == pytest.approx(0.85, abs=0.01)


# ----------------------------------------------------------------- the hand


def test_hand_holds_one_thing(world):
    world.step("PickupObject", objectId=reach(world, "Apple"))
    full = world.step("PickupObject", objectId=find(world, "Potato"), forceAction=True)
    assert "Agent hand has something in it already" in full.message


def test_held_object_hangs_before_the_camera_and_moves_along(world):
    apple = reach(world, "Apple")
    world.step("PickupObject", objectId=apple)
    for action in ("MoveLeft", "RotateRight", "LookDown", "Crouch"):
        event = world.step(action)
        assert look(world, apple)["position"] == event.metadata["heldObjectPose"]["position"]
        assert look(world, apple)["visible"]
        assert look(world, apple)["parentReceptacles"] is None


def test_picking_up_a_plate_takes_along_what_lies_on_it(world):
    plate, tomato = find(world, "Plate"), find(world, "Tomato")
    apart = np.subtract(world.state.objects[tomato].center, world.state.objects[plate].center)
    event, _, counter = bring(world, "Plate", "CounterTop")
    assert event, event.message
    assert look(world, tomato)["parentReceptacles"] == [plate, counter]
    assert look(world, plate)["parentReceptacles"] == [counter]
    after = np.subtract(world.state.objects[tomato].center, world.state.objects[plate].center)
    assert np.linalg.norm(apart) == pytest.approx(np.linalg.norm(after))


# ----------------------------------------------------------------- putting


def test_put_rests_on_the_surface_within_it_and_near_the_agent(world):
    event, apple, _ = bring(world, "Apple", "CounterTop")
    assert event, event.message
    box, counter = world.state.objects[apple], world.state.objects[find(world, "CounterTop")]
    assert box.center[1] - box.size[1] / 2 == pytest.approx(0.9, abs=0.01)
    for axis in (0, 2):
        far = abs(box.center[axis] - counter.center[axis]) + box.size[axis] / 2
        assert far <= counter.size[axis] / 2
    assert look(world, apple)["visible"]


def test_put_never_overlaps_what_lies_there(world):
    table = world.state.objects[find(world, "DiningTable")]
    apples = [
        on(table, "Apple", 1.4 + 0.0001 * i, 9.0 + i, size=(0.1, 0.1, 0.1)) for i in range(12)
    ]
    world = with_extra(*(msgspec.structs.replace(apple, parents=()) for apple in apples))
    for apple in apples:
        world.step("PickupObject", objectId=apple.id, forceAction=True)
        assert world.step("PutObject", objectId=table.id, forceAction=True)
    things = [t for t in world.state.objects.values() if table.id in t.parents]
    for one in things:
        for other in things:
            if one is not other:
                gaps = np.abs(np.subtract(one.center, other.center))
                assert (gaps >= np.add(one.size, other.size) / 2 - 1e-6).any()


@pytest.mark.parametrize("horizon", [0, 30, 60])
def test_put_prefers_places_that_the_agent_has_in_its_picture(world, horizon):
    fridge = world.state.objects[find(world, "Fridge")]
    high = [on(fridge, "Potato", -1.6, z, level=1.5) for z in (-0.5, 0.1)]  # a board much in use
    world = with_extra(*high)
    bread = find(world, "Bread")
    world.step("PickupObject", objectId=bread, forceAction=True)
    world.step("OpenObject", objectId=fridge.id, forceAction=True)
    place = {"x": -0.75, "y": 0.9, "z": -0.25}
    world.step("TeleportFull", **place, rotation=270, horizon=horizon, standing=True)
    assert world.step("PutObject", objectId=fridge.id)
    assert look(world, bread)["visible"]


def test_put_into_a_full_bowl_is_refused(world):
    bowl = find(world, "Bowl")
    apples = [thing("Apple", (0.0, 0.5 + i, 0.0), (0.1, 0.1, 0.1)) for i in range(12)]
    world = with_extra(*apples)
    messages = []
    for apple in apples:
        world.step("PickupObject", objectId=apple.id, forceAction=True)
        messages.append(world.step("PutObject", objectId=bowl, forceAction=True).message)
        if not world.last_event:
            world.step("DropHeldObject")
    assert messages[0] == ""
    assert messages[-1] == "No valid positions to place object found"


def test_put_into_a_cup_that_holds_a_knife_lays_a_spoon_on_it():
    cup = thing("Cup", (1.5, 0.85, -0.4), (0.09, 0.1, 0.09))
    knife = on(cup, "Knife", 1.5, -0.4, level=0.0, size=(0.05, 0.02, 0.25))
    forks = [thing("Fork", (0.0, 0.5 + i, 0.0), (0.03, 0.02, 0.2)) for i in range(9)]
    world, levels = with_extra(cup, knife, *forks), []
    for fork in forks:
        world.step("PickupObject", objectId=fork.id, forceAction=True)
        if not world.step("PutObject", objectId=cup.id, forceAction=True):
            assert world.last_event.message == "No valid positions to place object found"
            break
        there = world.state.objects[fork.id]
        assert there.parents[0] == cup.id
        levels.append(there.center[1] - there.size[1] / 2)
    else:
        pytest.fail("no end of what goes into a cup")
    assert levels[0] == pytest.approx(0.82, abs=0.01)  # on the knife
    assert levels == sorted(levels)
    assert levels[-1] < 0.9  # below the rim


@pytest.mark.parametrize(
    ("kind", "place", "force", "message"),
    [
        ("Apple", "Fridge", True, "is CLOSED"),
        ("Mug", "Bowl", False, "cannot be placed in"),
        ("Knife", "Bowl", False, ""),  # knives may lie anywhere
        ("Mug", "DiningTable", True, ""),
        ("Plate", "Plate", True, "NOT a receptacle"),
    ],
)
def test_put_is_refused_where_the_thing_cannot_go(world, kind, place, force, message):
    world.step("PickupObject", objectId=find(world, kind), forceAction=True)
    reach(world, place) if place != kind else None
    event = world.step("PutObject", objectId=find(world, place), forceAction=force)
    assert message in event.message
    assert bool(event) == (not message)


@pytest.mark.parametrize(("rules", "goes"), [(msgspec.UNSET, False), ("thor-2.1.0", True)])
def test_put_follows_the_table_of_the_scenes_rules(rules, goes):
    room = msgspec.structs.replace(kitchen(), rules=rules)
    event, _, _ = bring(EmbeddedWorld(room), "CellPhone", "Bowl")
    assert bool(event) == goes
    event, _, _ = bring(EmbeddedWorld(room), "CellPhone", "SinkBasin")
    assert "cannot be placed in" in event.message


# ----------------------------------------------------------------- opening, states, aiming


def test_closed_container_hides_its_contents_and_an_open_one_shows_them(world):
    egg, fridge = find(world, "Egg"), reach(world, "Fridge")
    assert not look(world, egg)["visible"]
    assert not world.step("PickupObject", objectId=egg)
    assert world.step("OpenObject", objectId=fridge, openness=0.5)
    assert look(world, fridge)["openness"] == 0.5
    reach(world, "Egg")
    assert look(world, egg)["visible"]
    assert world.step("OpenObject", objectId=fridge)  # AI2-THOR: opening what is open succeeds
    assert world.step("CloseObject", objectId=fridge)
    assert world.step("CloseObject", objectId=fridge)  # it is opening to the degree 0
    assert world.step("PickupObject", objectId=egg, forceAction=True)


@pytest.mark.parametrize(
    ("do", "undo", "kind", "flag"),
    [
        ("DirtyObject", "CleanObject", "Bowl", "isDirty"),
        ("CookObject", None, "Potato", "isCooked"),
        ("UseUpObject", None, "SoapBottle", "isUsedUp"),
    ],
)
def test_state_is_taken_on_once(world, do, undo, kind, flag):
    object_id = reach(world, kind)
    assert world.step(do, objectId=object_id), world.last_event.message
    assert look(world, object_id)[flag]
    assert "already" in world.step(do, objectId=object_id).message
    if undo:
        assert world.step(undo, objectId=object_id)
        assert not look(world, object_id)[flag]
    assert not world.step(do, objectId=find(world, "LightSwitch"), forceAction=True)


def test_object_in_the_middle_of_the_picture_can_be_named_by_where_it_is(world):
    world.step("TeleportFull", x=0.5, y=0.9, z=-0.5, rotation=90, horizon=30, standing=True)
    apple = find(world, "Apple")
    for row in range(10, 30):
        if world.step("PickupObject", x=0.5, y=row / 30) and world.state.held == apple:
            return
        world.step("DropHeldObject")
        world.reset(kitchen())
        world.step("TeleportFull", x=0.5, y=0.9, z=-0.5, rotation=90, horizon=30, standing=True)
    pytest.fail("no point of the middle column meets the apple")


# ----------------------------------------------------------------- seeing


def test_object_farther_than_the_visibility_distance_is_not_visible():
    table = find(EmbeddedWorld(kitchen()), "DiningTable")
    near, far = (
        EmbeddedWorld(kitchen(), visibilityDistance=1.5),
        EmbeddedWorld(kitchen(), visibilityDistance=1.0),
    )
    for world, seen in ((near, True), (far, False)):
        world.step("TeleportFull", x=0.0, y=0.9, z=0.0, rotation=90, horizon=30, standing=True)
        assert look(world, table)["visible"] is seen


def test_object_behind_the_agent_or_behind_a_wall_of_fridge_is_not_visible():
    hidden = thing("Vase", (-1.65, 0.9, -0.9), (0.1, 0.1, 0.1))
    world = with_extra(hidden)
    world.step("TeleportFull", x=-1.0, y=0.9, z=0.5, rotation=180, horizon=30, standing=True)
    assert not look(world, hidden.id)["visible"]  # the fridge is in the way
    world.step("TeleportFull", x=-1.0, y=0.9, z=-0.75, rotation=270, horizon=30, standing=True)
    assert look(world, hidden.id)["visible"]
    world.step("RotateRight", degrees=180)
    assert not look(world, hidden.id)["visible"]


def test_thing_in_a_basin_is_seen_through_the_worktops_hole_and_one_under_it_is_not():
    room = kitchen()
    basin = "SinkBasin|+00.00|+00.85|+01.15"
    top = thing("CounterTop", (0.0, 0.89, 1.2), (3.4, 0.02, 0.6))
    soap = thing("SoapBar", (0.1, 0.8, 1.2), (0.08, 0.03, 0.05), parents=(basin,))
    under = thing("DishSponge", (0.45, 0.8, 1.2), (0.08, 0.03, 0.05))
    rest = [t for t in room.objects if t.type in ("SinkBasin", "Floor")]
    world = EmbeddedWorld(msgspec.structs.replace(room, objects=(*rest, top, soap, under)))
    world.step("TeleportFull", x=0.25, y=0.9, z=0.25, rotation=0, horizon=45, standing=True)
    assert look(world, soap.id)["visible"]
    assert look(world, basin)["visible"]
    assert not look(world, under.id)["visible"]


def test_holes_are_of_basins_that_lie_in_a_worktop():
    above = thing("SinkBasin", (-1.5, 1.5, 1.2), (0.4, 0.14, 0.4))
    beside = thing("BathtubBasin", (-1.0, 0.3, 0.3), (0.6, 0.4, 0.6))
    objects = EmbeddedWorld(kitchen((above, beside))).state.objects
    (counter,) = objects.by_type["CounterTop"]
    (hole,) = holes(objects)[counter]
    assert hole.center == pytest.approx((0.0, 0.85, 1.15))


def test_object_behind_glass_is_visible_but_not_interactable():
    shut = thing("ShowerDoor", (0.0, 1.0, -1.3), (2.0, 2.0, 0.02))
    soap = thing("SoapBar", (0.0, 0.9, -1.5), (0.1, 0.05, 0.05))
    world = with_extra(shut, soap)
    world.step("TeleportFull", x=0.0, y=0.9, z=-1.0, rotation=180, horizon=30, standing=True)
    assert look(world, soap.id)["visible"]
    assert not look(world, soap.id)["isInteractable"]
    assert world.step("PickupObject", objectId=soap.id).code == "ObjectNotInteractable"


def test_visibility_agrees_with_the_genuine_simulator_at_reset(shared):
    """120 recorded scenes; the agent's place follows from its distances to all objects."""
    agree = extra = missing = 0
    for row, room in islice(recorded_rooms(shared), 0, None, 4):
        objects = Objects({thing.id: thing for thing in room.objects})
        truth = {o["objectId"] for o in row["objects"] if o["visible"]}
        seen = _best_view(objects, _agent_place(row["objects"]), truth)
        agree += len(seen & truth)
        extra += len(seen - truth)
        missing += len(truth - seen)
    assert agree / (agree + missing) > 0.95  # recall
    assert agree / (agree + extra) > 0.80  # precision: boxes are coarser than meshes


def test_things_in_basins_of_recorded_rooms_are_seen_from_three_poses_and_more(shared):
    for _, room in islice(recorded_rooms(shared), 2, 20, 3):  # kitchens
        objects = Objects({thing.id: thing for thing in room.objects})
        for one, center in _in_basins(room):
            near = [c for c in room.reachable if math.dist(c, (center[0], center[2])) < 1.2]
            poses = [
                Pose(position_m=(x, room.floor_y + 0.9, z), yaw_deg=yaw, horizon_deg=60.0)
                for x, z in near
                for yaw in (0.0, 90.0, 180.0, 270.0)
            ]
            seen = sum(one in sight(objects, pose).visible for pose in poses)
            assert seen >= 3, (room.name, one, seen)


def _in_basins(room):
    return [
        (thing.id, thing.center)
        for thing in room.objects
        if "pickupable" in thing.capabilities and any("Basin" in p for p in thing.parents)
    ]


def _best_view(objects, place, truth):
    """What our view sees, looking the way that agrees best; the yaw was not recorded."""
    views = [
        sight(objects, Pose(position_m=place, yaw_deg=yaw, horizon_deg=horizon)).visible
        for yaw in (0, 90, 180, 270)
        for horizon in (0, 30)
    ]
    return max(views, key=lambda seen: 2 * len(seen & truth) - len(seen ^ truth))


def _agent_place(rows):
    places = np.array([[row["position"][axis] for axis in "xyz"] for row in rows])
    far = np.array([row["distance"] for row in rows])
    normal = 2 * (places[1:] - places[0])
    offset = (places[1:] ** 2).sum(1) - (places[0] ** 2).sum() - far[1:] ** 2 + far[0] ** 2
    return tuple(float(value) for value in np.linalg.lstsq(normal, offset, rcond=None)[0])
