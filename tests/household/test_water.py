"""What a running tap reaches: the world, the judge of goals and the agent's memory say the same."""

import msgspec
import pytest
from support.floor_plans import floor_plans
from support.household import find, kitchen, on, thing

from karma.agent.seeing.perceive import observe, truth_of
from karma.household.uses import BASINS, TAPS
from karma.household.water import Lying, wetted
from karma.world.sim import EmbeddedWorld


def soiled(scene, **parents):
    """Return a scene in which everything can be dirty and is: so the world marks what gets wet."""
    return msgspec.structs.replace(
        scene,
        objects=tuple(
            msgspec.structs.replace(
                one,
                capabilities=tuple(dict.fromkeys((*one.capabilities, "dirtyable"))),
                is_dirty=True,
                is_toggled=one.is_toggled and one.type not in TAPS,
                parents=parents.get(one.type, one.parents),
            )
            for one in scene.objects
        ),
    )


def by_id(event):
    return {one["objectId"]: one for one in event.metadata["objects"]}


def told(world, tap):
    """Switch a tap on; return what the world, the judge and a memory of everything call washed."""
    before = by_id(world.last_event)
    event = world.step("ToggleObjectOn", objectId=tap, forceAction=True)
    assert event.metadata["lastActionSuccess"], event.metadata["errorMessage"]
    after = by_id(event)
    world_says = {key for key in before if before[key]["isDirty"] and not after[key]["isDirty"]}
    memory = observe(event, touched=[tap], known=before)
    assert world.step("ToggleObjectOff", objectId=tap, forceAction=True)
    return world_says, truth_of(event).washed, memory.washed


def in_a_counters_place(scene):
    """Return a kitchen as AI2-THOR lists some: the worktop lies in the basin let into it.

    With it all that stands on the worktop and under it, the fridge and what that holds.
    """
    ids = {one.type: one.id for one in scene.objects}
    return soiled(
        scene,
        CounterTop=(ids["SinkBasin"],),
        Faucet=(ids["CounterTop"],),
        Fridge=(ids["CounterTop"], ids["Floor"]),
    )


def test_a_tap_wets_what_lies_in_the_basin_and_not_the_worktop_round_it():
    basin = thing("SinkBasin", (0.0, 0.85, 1.15), (0.4, 0.14, 0.4))
    bowl = on(basin, "Pot", 0.0, 1.15, level=0.01, size=(0.2, 0.1, 0.2))
    lettuce = on(basin, "Lettuce", 0.12, 1.15, level=0.01, size=(0.1, 0.1, 0.1))
    potato = on(bowl, "Potato", 0.0, 1.15, size=(0.1, 0.08, 0.08))
    world = EmbeddedWorld(in_a_counters_place(kitchen([bowl, lettuce, potato])))
    chain = by_id(world.last_event)
    egg = chain[find(world, "Egg")]
    assert chain[egg["parentReceptacles"][0]]["parentReceptacles"][0].startswith("CounterTop")
    assert [*told(world, find(world, "Faucet"))] == [{bowl.id, lettuce.id, potato.id}] * 3


def test_water_does_not_get_into_a_box_that_is_shut():
    basin = thing("SinkBasin", (0.0, 0.85, 1.15), (0.4, 0.14, 0.4))
    box = on(basin, "Box", 0.0, 1.15, level=0.01, size=(0.3, 0.2, 0.3), openness=0.0)
    pen = on(box, "Pen", 0.0, 1.15, level=0.02)
    world = EmbeddedWorld(soiled(kitchen([box, pen])))
    assert [*told(world, find(world, "Faucet"))] == [{box.id}] * 3
    assert world.step("OpenObject", objectId=box.id, forceAction=True)
    assert told(world, find(world, "Faucet")) == ({pen.id}, {box.id, pen.id}, {box.id, pen.id})


def lying(name, x, z, *parents, y=0.9, size=(0.4, 0.1, 0.4), shut=False):
    return Lying(name, name.split("|")[-1].strip("0123456789"), (x, y, z), size, parents, shut)


@pytest.mark.parametrize(
    ("things", "wet"),
    [
        ([lying("SinkBasin1", 0, 0), lying("SinkBasin2", 2, 0), lying("Mug1", 0, 0, "SinkBasin1"),
          lying("Mug2", 2, 0, "SinkBasin2")], {"Mug1"}),  # of two the nearer one
        ([lying("SinkBasin1", 1.3, 0), lying("Mug1", 1, 0, "SinkBasin1")], set()),  # too far
        ([lying("SinkBasin1", 0, 0, y=1.5), lying("Mug1", 0, 0, "SinkBasin1")], set()),  # above
        ([lying("Sink1", 0, 0), lying("Mug1", 0, 0, "Sink1")], {"Mug1"}),  # has no basin
        ([lying("Bathtub1", 0, 0), lying("Bathtub1|BathtubBasin", 0, 0),
          lying("SoapBar1", 0, 0, "Bathtub1"), lying("Cloth1", 0, 0, "Bathtub1|BathtubBasin")],
         {"Cloth1"}),  # the soap lies on the rim
        ([lying("SinkBasin1", 0, 0), lying("CounterTop1", 0, 0, "SinkBasin1"),
          lying("ShowerCurtain1", 0, 0, "SinkBasin1"), lying("Plate1", 0, 0, "CounterTop1")],
         set()),
        ([], set()),
    ],
)  # fmt: skip
def test_water_stays_in_the_nearest_basin_below_the_tap(things, wet):
    tap = lying("Faucet1", 0, 0, y=1.1, size=(0.1, 0.3, 0.1))
    assert wetted(["Faucet1"], [tap, *things]) == wet
    assert wetted([], [tap, *things]) == wetted(["Microwave1"], [tap, *things]) == set()


@pytest.mark.shared
def test_world_judge_and_memory_agree_on_every_tap_of_every_floor_plan(shared):
    """With one more thing in every basin; nothing is called washed that does not lie over one."""
    laden = ran = 0
    for scene in floor_plans(shared):
        world = EmbeddedWorld(soiled(scene))
        basins = [one for one in scene.objects if one.type in BASINS]
        spare = [one.id for one in scene.objects if one.type in ("Cloth", "Cup", "SoapBar", "Egg")]
        for basin, name in zip(basins, spare, strict=False):
            world.step("PickupObject", objectId=name, forceAction=True)
            laden += bool(world.step("PutObject", objectId=basin.id, forceAction=True))
        for tap in (one.id for one in scene.objects if one.type in TAPS):
            ran += 1
            before = by_id(world.last_event)
            world_says, judge, memory = told(world, tap)
            assert judge == memory >= world_says, (scene.name, tap)
            assert all(not before[name]["isDirty"] for name in judge - world_says), scene.name
            assert all(_over(before[name], basins) for name in judge), (scene.name, tap)
    assert (ran, laden) == (105, 76)


def _over(one, basins):
    """Return whether a thing's middle is over one of the basins."""
    middle = one["axisAlignedBoundingBox"]["center"]
    return any(
        abs(middle["x"] - basin.center[0]) <= basin.size[0] / 2 + 0.01
        and abs(middle["z"] - basin.center[2]) <= basin.size[2] / 2 + 0.01
        for basin in basins
    )
