"""ALFRED's goals: when a demonstration has reached them."""

import pytest
from support import alfred_kitchen as ours

from karma.household.ids import type_of
from karma.plugins.alfred.replay.goal import Deeds, goal_met

APPLE, FRIDGE, TABLE = ours.APPLE, ours.FRIDGE, ours.TABLE


# ----------------------------------------------------------------- goals


def thing(one, *, contents=None, parents=None, **more):
    flags = {"pickupable": True, "receptacle": contents is not None, "toggleable": False}
    return {
        "objectId": one, "objectType": type_of(one), "receptacleObjectIds": contents,
        "parentReceptacles": parents, "isToggled": False, "visible": False, "isDirty": False,
        "temperature": "RoomTemp", "position": {"x": 0, "y": 0, "z": 0}, **flags, **more,
    }  # fmt: skip


def met(tmp_path, task, targets, things, held=(), deeds=None, exact=False):
    trial = ours.trial() | {"task_type": task}
    trial["pddl_params"] = {"object_target": "Pen", **targets}
    metadata = {"objects": things, "inventoryObjects": [{"objectId": one} for one in held]}
    return goal_met(ours.read(tmp_path, trial), metadata, deeds or Deeds(), exact=exact)


def test_goal_a_target_is_any_part_of_an_id_unless_exact(tmp_path):
    things = [thing("Pencil|1"), thing("Desk|1", contents=["Pencil|1"])]
    simple = ("pick_and_place_simple", {"parent_target": "Desk"}, things)
    assert met(tmp_path, *simple)
    assert not met(tmp_path, *simple, exact=True)


def test_goal_two_objects_have_to_be_in_one_receptacle(tmp_path):
    two = ("pick_two_obj_and_place", {"parent_target": "Desk"})
    apart = [thing("Desk|1", contents=["Pen|1"]), thing("Desk|2", contents=["Pen|2"])]
    pens = [thing("Pen|1"), thing("Pen|2")]
    assert not met(tmp_path, *two, [*pens, *apart])
    assert met(tmp_path, *two, [*pens, thing("Desk|1", contents=["Pen|1", "Pen|2"])])


@pytest.mark.parametrize(
    ("held", "lamp", "wanted"),
    [
        (["Pen|1"], {"isToggled": True, "visible": True}, True),
        (["Pen|1"], {"isToggled": True, "visible": False}, False),
        (["Pen|1"], {"isToggled": False, "visible": True}, False),
        ([], {"isToggled": True, "visible": True}, False),
    ],
)
def test_goal_light_is_on_in_view_and_the_object_held(tmp_path, held, lamp, wanted):
    lamp = thing("DeskLamp|1", **{"toggleable": True, "pickupable": False, **lamp})
    look = ("look_at_obj_in_light", {"toggle_target": "DeskLamp"}, [thing("Pen|1"), lamp])
    assert met(tmp_path, *look, held=held) is wanted


def test_goal_stack_is_in_the_receptacle_with_the_object_in_it(tmp_path):
    task = ("pick_and_place_with_movable_recep", {"parent_target": "Desk", "mrecep_target": "Cup"})
    pen, desk = thing("Pen|1"), thing("Desk|1", contents=["Cup|1"])
    cup = thing("Cup|1", contents=["Pen|1"], parents=["Desk|1"])
    assert met(tmp_path, *task, [pen, desk, cup])
    assert not met(tmp_path, *task, [pen, desk, thing("Cup|1", contents=[], parents=["Desk|1"])])
    assert not met(tmp_path, *task, [pen, desk, thing("Cup|1", contents=["Pen|1"])])


def test_goal_sliced_wants_as_many_pieces_as_objects(tmp_path):
    targets = {"object_target": "Apple", "parent_target": "Desk", "object_sliced": True}
    whole, desk = (
        thing("Apple|1"),
        thing("Desk|1", contents=["Apple|1", "Apple|1|0|0|AppleSliced_0"]),
    )
    piece = thing("Apple|1|0|0|AppleSliced_0")
    assert not met(tmp_path, "pick_and_place_simple", targets, [whole, desk])
    assert met(tmp_path, "pick_and_place_simple", targets, [whole, desk, piece])
    assert not met(tmp_path, "pick_two_obj_and_place", targets, [whole, desk, piece])


@pytest.mark.parametrize(
    ("kind", "action", "source", "state", "spoilt"),
    [
        ("heat", "ToggleObjectOn", "Microwave|1", {"temperature": "Hot"}, {}),
        ("cool", "CloseObject", "Fridge|1", {"temperature": "Cold"}, {}),
        ("clean", "ToggleObjectOn", "Faucet|1", {}, {"isDirty": True}),
    ],
)
def test_goal_treated_is_told_by_events_that_the_world_agrees_with(
    tmp_path, kind, action, source, state, spoilt
):
    task = f"pick_{kind}_then_place_in_recep"
    desk = thing("Desk|1", contents=["Pen|1"])

    def after(**flags):
        inside = source if kind != "clean" else "Sink|0|0|0|SinkBasin"
        places = [thing(inside, contents=["Pen|1"])]
        if kind == "clean":
            far = {"position": {"x": 5, "y": 0, "z": 0}}
            places += [thing(source), thing("Sink|5|0|0|SinkBasin", contents=["Pen|2"], **far)]
        deeds = Deeds()
        deeds.note(action, source, {"objects": [thing("Pen|1", **flags), thing("Pen|2"), *places]})
        return deeds

    things = [thing("Pen|1"), desk]
    targets = {"parent_target": "Desk"}
    assert met(tmp_path, task, targets, things, deeds=after(**state))
    assert not met(tmp_path, task, targets, things, deeds=after(**spoilt))
    assert not met(tmp_path, task, targets, things)
    elsewhere = [thing("Pen|1"), thing("Desk|1", contents=[])]
    assert not met(tmp_path, task, targets, elsewhere, deeds=after(**state))
