"""Looking for things in our own rooms: what was searched in vain is not searched again."""

import msgspec
import pytest
from support.household import Believes, kitchen, on

from karma.agent.body.reach import SkillLimits
from karma.agent.body.skills import Skills
from karma.agent.tour import floor_of, position_of
from karma.files import to_json
from karma.memory.scene_graph import SceneGraph
from karma.types.memory import Known
from karma.types.planning import SkillCall
from karma.world.sim import EmbeddedWorld


def explore(skills, name, *positions):
    return skills.run(SkillCall(skill="Explore", objects=(name,), positions=positions))


def do(skills, skill, *objects):
    result = skills.run(SkillCall(skill=skill, objects=objects))
    assert result.ok, result.reason
    return result


def of(world, name):
    objects = world.last_event.metadata["objects"]
    return next(t for t in objects if name in (t["objectId"], t["objectType"]))


@pytest.fixture
def world():
    return EmbeddedWorld("bathroom_1")


def searched(world):
    """Return skills that have searched the whole room in vain."""
    skills = Skills(world, Believes(()))
    result = explore(skills, "Basketball")
    assert result.reason == f"could not find Basketball; searched {result.explorations} places"
    return skills


# ----------------------------------------------------------------- in vain


def test_a_search_in_vain_is_refused_the_second_time(world):
    skills = searched(world)
    for position in ((), ((0.0, 0.0, 0.0),)):
        again = explore(skills, "Basketball", *position)
        assert (again.ok, again.actions, again.explorations) == (False, 0, 0)
        assert again.reason == "could not find Basketball; everything was searched before"


def test_what_one_search_saw_spares_the_next_one(world):
    skills = searched(world)
    result = explore(skills, "AlarmClock")
    assert (result.ok, result.actions, result.explorations) == (False, 0, 0)
    closed = next(t for t in world.last_event.metadata["objects"] if t["objectType"] == "Cabinet")
    inside = closed["receptacleObjectIds"]
    for kind in ["SoapBar", *(name.partition("|")[0] for name in inside)]:
        result = explore(skills, kind)
        assert result.ok, result.reason
        objects = world.last_event.metadata["objects"]
        assert next(t for t in objects if t["objectId"] == result.object_ids[-1])["visible"]


def test_after_a_deed_only_its_neighbourhood_is_searched_again(world):
    skills = searched(world)
    whole = skills.explorations
    do(skills, "OpenObject", "Cabinet")
    do(skills, "CloseObject", "Cabinet")
    again = explore(skills, "Basketball")
    assert not again.ok
    assert 0 < again.explorations < whole


def test_a_search_that_ran_out_of_actions_is_gone_on_with(world):
    whole = searched(world).actions
    world.reset("bathroom_1")
    skills = Skills(world, Believes(()), limits=SkillLimits(max_actions=whole // 3))
    reasons = [explore(skills, "Basketball").reason for _ in range(8)]
    assert reasons[0].startswith("gave up after ")
    assert reasons[-1] == "could not find Basketball; everything was searched before"
    assert skills.actions < whole * 1.5


@pytest.mark.parametrize("most", (60, 140))
def test_a_search_that_runs_out_of_actions_leaves_nothing_open(world, most):
    skills = Skills(world, Believes(()), limits=SkillLimits(max_actions=most))
    assert explore(skills, "Basketball").reason.startswith("gave up after ")
    assert not any(
        t["isOpen"] for t in world.last_event.metadata["objects"] if t["objectType"] == "Cabinet"
    )


# ----------------------------------------------------------------- basins


@pytest.mark.parametrize("room", ["bathroom_2", "kitchen_3"])
def test_a_thing_is_put_into_the_basin_that_was_not_in_view(room):
    world = EmbeddedWorld(room)
    sink, basin = of(world, "Sink"), of(world, "SinkBasin")
    thing = next(
        t for t in world.last_event.metadata["objects"]
        if t["objectType"] in ("SoapBar", "Mug")
    )  # fmt: skip
    cells = world.step("GetReachablePositions").metadata["actionReturn"]
    unseen = 0
    for cell in cells:
        for yaw in (0.0, 90.0, 180.0, 270.0):
            here = {"position": cell, "rotation": {"x": 0.0, "y": yaw, "z": 0.0}}
            world.step("TeleportFull", **here, horizon=0.0, standing=True)
            if of(world, "Sink")["isInteractable"] and not of(world, "SinkBasin")["visible"]:
                unseen += 1
                world.step("PickupObject", objectId=thing["objectId"], forceAction=True)
                do(Skills(world, Believes(())), "PutObject", thing["objectType"], "Sink")
                assert basin["objectId"] in of(world, thing["objectType"])["parentReceptacles"]
    assert unseen > 3, sink["objectId"]


# ----------------------------------------------------------------- what is in the way


def shut_away(world, kind, container):
    """Put the first of a type into a container and close it."""
    world.step("PickupObject", objectId=of(world, kind)["objectId"], forceAction=True)
    world.step("OpenObject", objectId=container, forceAction=True)
    world.step("PutObject", objectId=container, forceAction=True)
    world.step("CloseObject", objectId=container, forceAction=True)
    assert container in of(world, kind)["parentReceptacles"]


@pytest.mark.parametrize(
    "room, kind, container",
    [
        ("kitchen_2", "Apple", "Cabinet|+00.04|+00.48|-01.56"),  # at the other end of it
        ("bedroom_1", "KeyChain", "Drawer|+01.61|+00.47|-02.12"),  # in a corner of the room
    ],
)
def test_a_thing_is_found_that_is_hard_to_see(room, kind, container):
    world = EmbeddedWorld(room)
    areas = SceneGraph.over(floor_of(world), height_m=position_of(world)[1]).areas()
    shut_away(world, kind, container)
    result = explore(Skills(world, Believes((), areas)), kind)
    assert result.ok, result.reason
    assert result.object_ids == (of(world, kind)["objectId"],)


def test_looked_into_means_seen_into_also_past_what_is_found_in_there(tmp_path):
    """The box in the fridge is seen only when the fridge is open; it hides the lettuce."""
    room = kitchen()
    fridge = next(one for one in room.objects if one.type == "Fridge")
    box = on(fridge, "Box", -1.56, -0.27, level=1.3, size=(0.35, 0.3, 0.3))
    lettuce = on(fridge, "Lettuce", -1.84, -0.41, level=1.3, size=(0.12, 0.12, 0.12))
    path = tmp_path / "room.json"
    path.write_bytes(to_json(msgspec.structs.replace(room, objects=(*room.objects, box, lettuce))))
    result = explore(Skills(EmbeddedWorld(str(path)), Believes(())), "Lettuce")
    assert result.ok, result.reason


def test_a_container_that_stands_open_is_looked_into(world):
    kind = "ToiletPaper"
    cabinet = of(world, "Cabinet")["objectId"]
    shut_away(world, kind, cabinet)
    world.step("OpenObject", objectId=cabinet, forceAction=True)
    result = explore(Skills(world, Believes(())), kind)
    assert result.ok, result.reason
    assert of(world, "Cabinet")["isOpen"]


class Remembers(Believes):
    """One thing is remembered, and what it lay in."""

    def __init__(self, known):
        super().__init__(())
        self.known = known

    def where(self, name):
        return self.known if name in (self.known.object_id, self.known.object_type) else None


def test_what_lies_in_a_bowl_in_a_closed_container_is_not_missed():
    world = EmbeddedWorld("kitchen_1")
    cabinet, bowl, egg = (of(world, kind)["objectId"] for kind in ("Fridge", "Bowl", "Egg"))
    for thing, place in ((egg, bowl), (bowl, cabinet)):
        world.step("PickupObject", objectId=thing, forceAction=True)
        world.step("OpenObject", objectId=cabinet, forceAction=True)
        world.step("PutObject", objectId=place, forceAction=True)
    world.step("CloseObject", objectId=cabinet, forceAction=True)
    at = of(world, "Egg")["position"]
    known = Known(
        object_id=egg,
        object_type="Egg",
        position_m=(at["x"], at["y"], at["z"]),
        place_id=bowl,
    )
    skills = Skills(world, Remembers(known))
    result = skills.run(SkillCall(skill="PickupObject", objects=("Egg",)))
    assert result.reason == "Egg is in the closed Fridge; OpenObject(robot, 'Fridge') first"
    do(skills, "OpenObject", "Fridge")
    do(skills, "PickupObject", "Egg")
