"""What memory says after deeds is what is so: where things are, in what, and how."""

import msgspec
import pytest
from support.experiences import begun
from support.household import kitchen

from karma.models.scripted import ScriptedModel
from karma.types.completion import Decoding
from karma.types.tasks import SubTask


@pytest.fixture
def start(tmp_path):
    """A function that begins an episode whose model says the given programs."""

    def begin(*answers, refusing=False, without=()):
        kept = tuple(one for one in kitchen().objects if one.type not in without)
        room = msgspec.structs.replace(kitchen(), objects=kept)
        decoding = Decoding(attempts=1, refusing=refusing)
        return begun(tmp_path, ScriptedModel(answers), room=room, decoding=decoding)

    return begin


def do(episode, words):
    *_, outcome = episode.do(SubTask(instruction=words))
    return outcome


def put(thing, place):
    return (
        f"Explore(robot, '{thing}')\nPickupObject(robot, '{thing}')\n"
        f"GoToObject(robot, '{place}')\nPutObject(robot, '{thing}', '{place}')\n"
    )


def unit(episode, kind):
    return next(one for one in episode.memory.short_term.units() if one.object_type == kind)


def truth(world, kind):
    things = world.last_event.metadata["objects"]
    return next(one for one in things if one["objectType"] == kind)


@pytest.mark.parametrize("together", [False, True])
def test_what_lies_in_a_carried_vessel_moves_with_it_at_every_depth(start, together):
    """The spoon in the mug, the mug on the plate, the plate on another surface."""
    deeds = [put("Spoon", "Mug"), put("Mug", "Plate"), put("Plate", "CounterTop")]
    deeds = ["".join(deeds)] if together else deeds
    episode, world = start(*deeds, without=("Tomato",))
    for deed in range(len(deeds)):
        assert do(episode, f"deed {deed}").finished
    for kind in ("Spoon", "Mug", "Plate"):
        x, y, z = unit(episode, kind).position_m
        there = truth(world, kind)["position"]
        assert (x, y, z) == pytest.approx(tuple(there[a] for a in "xyz"), abs=0.15), kind
        assert unit(episode, kind).place_id in truth(world, kind)["parentReceptacles"]


HEAT = (
    "Explore(robot, 'Potato')\nPickupObject(robot, 'Potato')\nOpenObject(robot, 'Microwave')\n"
    "PutObject(robot, 'Potato', 'Microwave')\nCloseObject(robot, 'Microwave')\n"
    "ToggleOn(robot, 'Microwave')\nToggleOff(robot, 'Microwave')\nOpenObject(robot, 'Microwave')\n"
    "PickupObject(robot, 'Potato')\n"
)
CHILL = (
    "OpenObject(robot, 'Fridge')\nPutObject(robot, 'Potato', 'Fridge')\n"
    "CloseObject(robot, 'Fridge')\n"
)
OUT = "OpenObject(robot, 'Fridge')\nPickupObject(robot, 'Potato')\n"


def test_chilling_ends_hot_and_heating_ends_cold_in_memory_and_in_what_is_said(start):
    episode, world = start(HEAT, CHILL + OUT, HEAT.partition("\n")[2].partition("\n")[2])
    assert "heated" in _told(do(episode, "heat it"), episode)
    assert truth(world, "Potato")["temperature"] == "Hot"
    states = _told(do(episode, "chill it"), episode)
    assert ("cooled" in states, "heated" in states) == (True, False)
    assert truth(world, "Potato")["temperature"] == "Cold"
    states = _told(do(episode, "heat it again"), episode)
    assert ("cooled" in states, "heated" in states) == (False, True)


def _told(outcome, episode):
    assert outcome.finished
    return unit(episode, "Potato").states


def test_what_lay_in_a_vessel_that_was_thrown_is_believed_nowhere_but_where_it_was_seen(start):
    throw = "Explore(robot, 'Mug')\nPickupObject(robot, 'Mug')\nThrowObject(robot, 'Mug')\n"
    episode, world = start(put("Spoon", "Mug"), throw)
    for deed in ("fill it", "throw it"):
        assert do(episode, deed).finished
    for one in episode.memory.short_term.units():
        if one.object_type == "Spoon":
            there = world.last_event.get_object(one.object_id)
            assert one.place_id in (None, *(there["parentReceptacles"] or ()))
            gap = [one.position_m[i] - there["position"][a] for i, a in enumerate("xyz")]
            assert max(map(abs, gap)) < 0.35
