"""What a refusal says in full, and when another receptacle will do."""

import dataclasses
import re

import pytest
from support.household import Believes, kitchen, look, on, thing

from karma.agent.body.reach import SkillLimits
from karma.agent.body.refusals import contents, explained
from karma.agent.body.sightings import Sightings
from karma.agent.body.skills import Skills
from karma.agent.seeing.perceive import reason_of
from karma.types.memory import Area, Known
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall
from karma.world.sim import EmbeddedWorld

MICROWAVE = Known(
    object_id="Microwave|-01.20|+01.05|+01.25", object_type="Microwave", position_m=(0, 0, 0)
)


@pytest.mark.parametrize(
    ("words", "meaning"),
    [
        ("Target must be closed to Toggle On!", "CloseObject(robot, 'Microwave|"),
        ("Target must be OFF to open!", "ToggleOff(robot, 'Microwave|"),
        ("Target openable Receptacle is CLOSED, can't place", "OpenObject(robot, 'Microwave|"),
        ("target object cannot be sliced if it is in the agent's hand", "put it down first"),
        ("Microwave must have the property pickupable", "cannot be picked up"),
        ("Microwave does not have the property sliceable!", "cannot be sliced"),
        ("Microwave does not have the property canFillWithLiquid!", "holds no liquid"),
        ("Microwave|1 is not an Openable object", "cannot be opened"),
        ("Microwave|1 is not a toggleable object", "cannot be switched"),
        ("Microwave is broken and cannot be switched on.", "no other is known"),
        ("Target object not found within the specified visibility.", "something is in the way"),
        ("a meteor fell", "a meteor fell"),
    ],
)
def test_world_s_words_become_blocker_and_remedy(words, meaning):
    told = explained(reason_of(words), MICROWAVE)
    assert told.startswith(MICROWAVE.object_id)
    assert meaning in told


def seen(object_id, *parents):
    return SeenObject(
        object_id=object_id, object_type=object_id.partition("|")[0], position_m=(0, 0, 0),
        box_center_m=(0, 0, 0), box_size_m=(0, 0, 0), pickupable=True, parent_ids=parents,
    )  # fmt: skip


def test_contents_are_what_was_seen_there_slices_once_and_the_basin_s_too():
    sliced = [
        dataclasses.replace(seen(f"Apple|1|1|1|AppleSliced_{n}", "Sink|1|1|1|SinkBasin"),
                            object_type="AppleSliced")
        for n in range(3)
    ]  # fmt: skip
    log = Sightings(
        seen={one.object_id: one for one in [
            *sliced, seen("Mug|1|1|1", "Sink|1|1|1"), seen("Cup|1|1|1", "Sink|1|1|10"),
            seen("Pan|1|1|1", "Sink|1|1|1"),
        ]},
        missed={"Pan|1|1|1": (0.0, 0.0, 0.0)},
    )  # fmt: skip
    assert contents("Sink|1|1|1", log) == ["Apple|1|1|1|AppleSliced_0", "Mug|1|1|1"]


# ----------------------------------------------------------------- in the world


def remembering(things, fixtures=()):
    """Knows where every thing was at reset, and some furniture that is nowhere to be got at."""
    return Believes(things, [Area(name="node_1", position_m=(0, 0, 0), fixtures=tuple(fixtures))])


ONE = thing("SideTable", (-0.4, 0.25, -1.5), (0.26, 0.5, 0.26))
OTHER = thing("SideTable", (0.6, 0.25, -1.5), (0.26, 0.5, 0.26))
CUP = on(ONE, "Cup", -0.4, -1.5, size=(0.2, 0.1, 0.2))


@pytest.fixture
def holding():
    """Skills in a kitchen with a full and a free side table, both seen, and a potato in hand."""
    room = kitchen((ONE, OTHER, CUP))
    world = EmbeddedWorld(room)
    skills = Skills(world, remembering(room.objects))
    potato = next(one.id for one in room.objects if one.type == "Potato")
    for skill, name in (("PickupObject", potato), ("GoToObject", OTHER.id), ("GoToObject", ONE.id)):
        assert skills.run(SkillCall(skill=skill, objects=(name,))).ok
    return skills, world, potato


def test_remembered_furniture_that_is_full_gives_way_to_another_of_its_type(holding):
    skills, world, potato = holding
    result = skills.run(SkillCall(skill="PutObject", objects=(potato, ONE.id)))
    assert result.ok
    assert result.reason == "the nearest SideTable is full, another one was taken"
    assert OTHER.id in look(world, potato)["parentReceptacles"]


def test_receptacle_that_is_meant_exactly_is_refused_when_full(holding):
    skills, world, potato = holding
    call = SkillCall(skill="PutObject", objects=(potato, ONE.id), exact=True)
    result = skills.run(call)
    assert (result.ok, result.reason) == (False, "No valid positions to place object found")
    for name in (ONE.id, CUP.id, OTHER.id, potato):
        assert name in result.detail
    assert look(world, potato)["isPickedUp"]


def test_remembered_plate_that_is_full_is_not_exchanged_for_another():
    table = next(one for one in kitchen().objects if one.type == "DiningTable")
    free = on(table, "Plate", 1.85, 0.05, size=(0.2, 0.02, 0.2))
    room = kitchen((free,))
    skills = Skills(EmbeddedWorld(room), remembering(room.objects))
    laden = next(one.id for one in room.objects if one.type == "Plate")
    bread = next(one.id for one in room.objects if one.type == "Bread")
    assert skills.run(SkillCall(skill="PickupObject", objects=(bread,))).ok
    result = skills.run(SkillCall(skill="PutObject", objects=(bread, laden)))
    assert "No valid positions" in result.reason
    assert "Tomato|" in result.detail and free.id in result.detail


def test_furniture_out_of_reach_names_others_of_its_kind():
    lost = thing("Cabinet", (9.0, 0.4, 9.0))
    there = next(one for one in kitchen().objects if one.type == "Cabinet")
    fixtures = [Known(object_id=one.id, object_type=one.type, position_m=one.position)
                for one in (lost, there)]  # fmt: skip
    skills = Skills(EmbeddedWorld(kitchen()), remembering([lost], fixtures))
    result = skills.run(SkillCall(skill="OpenObject", objects=(lost.id,)))
    assert result.reason == "could not get Cabinet into view and reach"
    assert result.detail.endswith(f"others of its kind: {there.id}")


def test_search_that_ran_out_of_actions_says_so_and_goes_on_when_asked_again():
    skills = Skills(EmbeddedWorld(kitchen()), remembering(()), limits=SkillLimits(max_actions=40))
    search = SkillCall(skill="Explore", objects=("Spoon",))
    results = [skills.run(search) for _ in range(20)]
    first = results[0]
    assert re.fullmatch(r"gave up after \d+ actions on Spoon", first.reason)
    assert "not all of this room was searched: Explore(robot, 'Spoon') goes on" in first.detail
    assert not [one for one in results if "searched" in one.reason]
    assert results[-1].ok
