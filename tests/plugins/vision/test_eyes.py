"""Eyes that see by pictures alone: what they know is what boxes, depth and a reader told them."""

import pytest
from support.household import Believes

from karma.agent.body.skills import Skills
from karma.agent.seeing.perceive import observe, truth_of
from karma.models.scripted import BlindVision, MetadataVision
from karma.plugins.vision.picture_eyes import GivenBoxes, PictureEyes
from karma.types.planning import SkillCall
from karma.world.sim import EmbeddedWorld

FLAGS = {"renderDepthImage": True, "renderInstanceSegmentation": True}


class Reader:
    """Answers with one word for everything, and counts how often it is asked."""

    name, needs_pictures = "reader", True

    def __init__(self, *words):
        self.words, self.asked = words, []

    def read_states(self, image, instruction, objects):
        assert image.shape == (300, 300, 3)
        assert all(one.states == () and one.region is not None for one in objects)
        self.asked += [one.object_id for one in objects]
        return {one.object_id: self.words for one in objects}


@pytest.fixture
def world():
    return EmbeddedWorld("kitchen_1", **FLAGS)


def seen_by(vision, event):
    return PictureEyes(vision, GivenBoxes()).observe(event)


def turns(world):
    yield world.last_event
    for action in ("LookDown", *["RotateRight"] * 4):
        yield world.step(action)


def test_pictures_show_nearly_what_the_simulator_calls_visible(world):
    both = shown = true = 0
    for event in turns(world):
        there = {one.object_id for one in observe(event).seen if one.object_type != "Floor"}
        seen = {one.object_id for one in seen_by(BlindVision(), event).seen}
        both, shown, true = both + len(there & seen), shown + len(seen), true + len(there)
    assert both > 0.85 * true
    assert both > 0.7 * shown


def test_places_from_pictures_are_near_the_true_ones(world):
    for event in turns(world):
        true = {one.object_id: one for one in truth_of(event).objects}
        for one in seen_by(BlindVision(), event).seen:
            if one.pickupable:
                gap = sum(
                    (a - b) ** 2
                    for a, b in zip(one.position_m, true[one.object_id].box_center_m, strict=True)
                )
                assert gap**0.5 < 0.2


def test_states_are_read_when_asked_for_and_once_per_view(world):
    world.reset("bedroom_1")
    reader = Reader("opened")
    observation, door = next(
        (observation, one)
        for observation in (seen_by(reader, event) for event in turns(world))
        for one in observation.seen
        if one.object_type == "Drawer"
    )
    assert reader.asked == []
    assert door.states == ()
    assert observation.look_at(door) == observation.look_at(door) == ("opened",)
    assert reader.asked == [door.object_id]


def test_true_states_come_only_with_a_reader_that_tells_them(world):
    world.reset("bedroom_1")
    told = {}
    for event in turns(world):
        true = {one.object_id: one.states for one in truth_of(event).objects}
        for one in seen_by(MetadataVision(), event).seen:
            told[one.object_id] = one.states
            assert one.states == true[one.object_id]
        assert not any(one.states for one in seen_by(BlindVision(), event).seen)
    assert any(told.values())


def test_what_is_put_somewhere_is_believed_to_be_there_and_the_tap_washes_it():
    world = EmbeddedWorld("kitchen_3", **FLAGS)
    eyes = PictureEyes(BlindVision(), GivenBoxes())
    skills = Skills(world, Believes(()), eyes=eyes)
    for skill, *objects in (
        ("Explore", "Mug"), ("PickupObject", "Mug"), ("Explore", "Sink"),
        ("PutObject", "Mug", "Sink"), ("ToggleOn", "Faucet"),
    ):  # fmt: skip
        result = skills.run(SkillCall(skill=skill, objects=tuple(objects)))
        assert result.ok, result.reason
    mug = next(name for name in skills.experience.handled_ids if name.startswith("Mug"))
    assert skills.experience.seen[mug].parent_ids[0].endswith("SinkBasin")
    assert "cleaned" in skills.experience.effects[mug]


def test_hand_is_felt_and_what_it_holds_is_not_in_view(world):
    eyes = PictureEyes(BlindVision(), GivenBoxes())
    skills = Skills(world, Believes(()), eyes=eyes)
    assert skills.run(SkillCall(skill="Explore", objects=("Egg",))).ok
    assert skills.run(SkillCall(skill="PickupObject", objects=("Egg",))).ok
    seen = eyes.observe(world.last_event)
    assert seen.held is not None
    assert seen.held.parent_ids == ("hand",)
    assert seen.held.object_id not in {one.object_id for one in seen.seen}


def test_closed_containers_are_searched_by_one_who_reads_no_states():
    world = EmbeddedWorld("kitchen_3", **FLAGS)
    inside = [
        one
        for one in truth_of(world.last_event).objects
        if one.pickupable and one.parent_ids and one.parent_ids[0].startswith("Fridge")
    ]
    others = {one.object_type for one in truth_of(world.last_event).objects if one not in inside}
    name = next(one.object_type for one in inside if one.object_type not in others)
    skills = Skills(world, Believes(()), eyes=PictureEyes(BlindVision(), GivenBoxes()))
    assert skills.run(SkillCall(skill="Explore", objects=(name,))).ok
