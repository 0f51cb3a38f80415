"""With a model that looks, states of memory units come from pictures, and the pictures are kept."""

import io

import numpy as np
import pytest
from support.experiences import begun

from karma.agent.body.sightings import Sightings
from karma.agent.seeing.perceive import observe
from karma.agent.seeing.picture_states import keep, look_at, png
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld

PROGRAM = (
    "Explore(robot, 'Apple', ['node_3'])\nGoToObject(robot, 'Apple')\n"
    "PickupObject(robot, 'Apple')\nGoToObject(robot, 'SinkBasin')\n"
    "PutObject(robot, 'Apple', 'SinkBasin')\n"
)


class Looking:
    """Answers from a list, and keeps what it was shown."""

    name, needs_pictures = "looking", True

    def __init__(self, **words):
        self.words, self.shown = words, []

    def read_states(self, image, instruction, objects):
        self.shown.append((image, instruction, objects))
        return {
            one.object_id: self.words[one.object_type]
            for one in objects
            if one.object_type in self.words
        }


@pytest.fixture
def acted(tmp_path):
    """A function that carries an apple to the sink and returns what memory holds then."""

    def run(vision):
        episode, _ = begun(tmp_path, ScriptedModel([PROGRAM]), vision=vision, seen_kept=1)
        list(episode.do(SubTask(instruction="put the apple in the sink")))
        return {unit.object_type: unit for unit in episode.memory.short_term.units()}

    return run


def test_states_of_units_are_what_the_model_said(acted):
    vision = Looking(Apple=("cooked", "heated"))
    apple = acted(vision)["Apple"]
    assert apple.states == ("cooked", "heated")
    image, instruction, objects = next(
        one for one in vision.shown if any(o.object_type == "Apple" for o in one[2])
    )
    assert image.shape == (300, 300, 3)
    assert instruction == "put the apple in the sink"
    assert all(one.states == () and one.region is not None for one in objects)


def test_the_picture_is_kept_in_the_run_folder_and_the_unit_names_it(acted, tmp_path):
    from PIL import Image

    vision = Looking()
    unit = acted(vision)["Apple"]
    assert unit.image.startswith("short_term/images/")
    with Image.open(tmp_path / unit.image) as kept:
        frames = [image for image, _, _ in vision.shown]
        assert any((np.asarray(kept) == frame).all() for frame in frames)


def test_a_model_that_does_not_look_draws_and_keeps_nothing(acted, tmp_path):
    assert acted(MetadataVision())["Apple"].image is None
    assert not (tmp_path / "short_term").exists()


def test_objects_of_one_picture_are_asked_about_at_once_and_unseen_ones_not():
    world, log, vision = EmbeddedWorld("kitchen_1"), Sightings(), Looking()
    log.add(observe(world.last_event))
    sights = list(log.seen.values())
    look_at(vision, "look", sights, log.views, None)
    assert [len(objects) for _, _, objects in vision.shown] == [len(sights)]
    assert look_at(vision, "look", sights, {}, None).states == {}


def test_equal_pictures_are_one_file_and_any_reader_opens_it(tmp_path):
    from PIL import Image

    frame = np.random.default_rng(1).integers(0, 255, (5, 7, 3), dtype=np.uint8)
    assert keep(frame, tmp_path) == keep(frame.copy(), tmp_path)
    assert len(list((tmp_path / "short_term/images").iterdir())) == 1
    with Image.open(io.BytesIO(png(frame))) as opened:
        assert (np.asarray(opened) == frame).all()
