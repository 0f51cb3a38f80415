"""Programs that ask for two things by one name, and the skills that then take two."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.household import Believes

from karma.agent.body.skills import Skills
from karma.agent.planning.planner import grounded
from karma.agent.planning.program import parse_program
from karma.agent.planning.turns import with_turns
from karma.household.pieces import base_type
from karma.world.core import scene
from karma.world.sim import EmbeddedWorld
from tests.agent.test_skills import known_room, thing

FETCH = "GoToObject(robot, '{x}')\nPickupObject(robot, '{x}')\nPutObject(robot, '{x}', '{r}')\n"
NAMES = st.sampled_from(["Mug", "Fork", "Desk", "Sink", "Mug_2"])


def turns(text):
    return [call.turn for call in with_turns(parse_program(text))]


def skills_called(text):
    return [call.skill for call in with_turns(parse_program(text))]


def test_a_thing_put_into_the_same_place_again_is_another_one():
    text = FETCH.format(x="Pen", r="Desk") * 3
    assert turns(text) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert skills_called(text)[3] == "Explore"


def test_two_washed_things_are_two_from_the_second_washing_on():
    wash = FETCH.format(x="Fork", r="Sink") + "ToggleOn(robot, 'Faucet')\n"
    text = (wash + FETCH.format(x="Fork", r="Drawer")) * 2
    assert turns(text) == [0] * 7 + [1, 1, 1, 0, 1, 1, 1]


def test_a_knife_that_goes_back_to_its_place_stays_the_same():
    cut = "GoToObject(robot, '{x}')\nSliceObject(robot, '{x}')\nPutObject(robot, 'Knife', 'Sink')\n"
    take = "PickupObject(robot, 'Knife')\n"
    text = take + cut.format(x="Apple") + take + cut.format(x="Bread")
    assert set(turns(text)) == {0}


@given(st.lists(st.tuples(NAMES, NAMES), max_size=8))
def test_turns_only_search_more_and_count_up(pairs):
    calls = parse_program("".join(FETCH.format(x=x, r=r) for x, r in pairs))
    found = with_turns(calls)
    assert [call.objects for call in found] == [call.objects for call in calls]
    for name in {call.objects[0] for call in calls}:
        own = [call.turn for call in found if call.objects[0] == name]
        assert own == sorted(own)
    changed = [new.turn for new, old in zip(found, calls, strict=True) if new.skill != old.skill]
    assert all(changed)


def test_grounding_leaves_the_second_of_two_things_a_type():
    calls = grounded(parse_program(FETCH.format(x="Pen", r="Desk") * 2), {"Pen": "Pen|1"})
    assert [call.objects[0] for call in calls] == ["Pen|1"] * 3 + ["Pen"] * 3


def of_two():
    """Return (scene, type): movable things of which a shipped room has two or more."""
    for name in sorted(path.stem for path in scene.SCENES.glob("*.json")):
        kinds = [t.type for t in scene.load(name).objects if "pickupable" in t.capabilities]
        for kind in sorted(set(kinds)):
            if kinds.count(kind) > 1 and base_type(kind) == kind:
                yield name, kind


@pytest.mark.parametrize("known", [True, False], ids=["known places", "nothing known"])
def test_two_of_a_kind_lie_in_the_place_after_a_program_that_says_it_twice(known):
    name, kind = next(of_two())
    world = EmbeddedWorld(name)
    skills = Skills(world, known_room(name) if known else Believes(()))
    place = next(
        surface
        for surface in ("CounterTop", "DiningTable", "Bed", "Desk", "Sofa", "SideTable")
        if any(t.type == surface for t in scene.load(name).objects)
    )
    text = f"Explore(robot, '{place}')\nExplore(robot, '{kind}')\n"
    for call in grounded(parse_program(text + FETCH.format(x=kind, r=place) * 2), {}):
        result = skills.run(call)
        assert result.ok, (str(call), result.reason)
    moved = {one for one in skills.experience.handled_ids if one.startswith(kind + "|")}
    assert len(moved) == 2
    for one in moved:
        assert any(p.startswith(place) for p in thing(world, one)["parentReceptacles"])
