"""A detector's boxes: names that last, and actions that are aimed at a place in the picture."""

import numpy as np
import pytest
from support.household import Believes

from karma.agent.body.skills import Skills
from karma.agent.seeing.perceive import camera_of
from karma.household.ids import type_of
from karma.household.types import object_types
from karma.models.scripted import BlindVision
from karma.plugins.vision.depth import pixels_of
from karma.plugins.vision.detected import Detection, TrackedBoxes, words_by_type
from karma.plugins.vision.picture_eyes import PictureEyes
from karma.types.planning import SkillCall
from karma.world.sim import EmbeddedWorld


class Pointing:
    """A detector without error: it names what the simulator's masks show, and no ids."""

    name = "pointing"

    def __init__(self, world, *, masks=True):
        self.world, self.masks, self.turns = world, masks, []

    def detect(self, image, words):
        assert image is self.world.last_event.frame
        self.turns.append(tuple(words))
        found = []
        for name, mask in self.world.last_event.instance_masks.items():
            word = next((w for w, kind in words_by_type().items() if kind == type_of(name)), "")
            if word in words:
                rows, columns = np.nonzero(mask)
                box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
                found.append(
                    Detection(
                        label=word,
                        score=0.9,
                        box_px=tuple(float(edge) for edge in box),
                        mask=mask if self.masks else None,
                    )
                )
        return found


@pytest.fixture
def world():
    return EmbeddedWorld("kitchen_1", renderDepthImage=True, renderInstanceSegmentation=True)


def found(boxes, world):
    event = world.last_event
    return list(boxes.find(pixels_of(event), camera_of(event), None))


def test_words_stand_for_every_type_but_the_floor():
    assert set(words_by_type().values()) == set(object_types()) - {"Floor"}


def test_detector_is_asked_in_turns_for_all_words(world):
    pointing = Pointing(world)
    found(TrackedBoxes(pointing), world)
    assert sorted(word for turn in pointing.turns for word in turn) == sorted(words_by_type())
    assert max(map(len, pointing.turns)) <= 20


@pytest.mark.parametrize("masks", [True, False])
def test_things_keep_their_names_when_looked_at_again(world, masks):
    boxes = TrackedBoxes(Pointing(world, masks=masks))
    first = [one.object_id for one in found(boxes, world)]
    assert len(set(first)) == len(first) > 5
    assert [one.object_id for one in found(boxes, world)] == first


def test_names_are_made_of_type_and_place_not_taken_from_the_simulator(world):
    seen = found(TrackedBoxes(Pointing(world)), world)
    true = set(world.last_event.instance_masks)
    assert len({one.object_id for one in seen} & true) < len(seen) / 3  # some agree by chance
    assert all(type_of(one.object_id) == one.object_type for one in seen)


def test_thing_that_is_not_in_the_picture_is_refused_by_the_world(world):
    boxes = TrackedBoxes(Pointing(world))
    event = world.step("PickupObject", **boxes.aim("Mug|nowhere"))
    assert not event


def test_agent_picks_up_and_puts_down_by_pointing_into_the_picture(world):
    skills = Skills(
        world, Believes(()), eyes=PictureEyes(BlindVision(), TrackedBoxes(Pointing(world)))
    )
    calls = (
        ("Explore", "Potato"), ("PickupObject", "Potato"), ("Explore", "Fridge"),
        ("OpenObject", "Fridge"), ("PutObject", "Potato", "Fridge"),
    )  # fmt: skip
    for skill, *objects in calls:
        result = skills.run(SkillCall(skill=skill, objects=tuple(objects)))
        assert result.ok, (skill, result.reason)
    things = {one["objectId"]: one for one in world.last_event.metadata["objects"]}
    inside = [name for name in things if name.startswith("Potato")]
    assert any(parent.startswith("Fridge") for name in inside
               for parent in things[name]["parentReceptacles"])  # fmt: skip
