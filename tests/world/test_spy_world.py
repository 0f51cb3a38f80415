"""The spy that proves a method honest is honest itself, and catches who is not."""

import pytest
from support.household import kitchen
from support.spy_world import SpyWorld

from karma.files import to_json
from karma.world.sim import EmbeddedWorld


@pytest.fixture
def worlds(tmp_path):
    path = tmp_path / "handmade.json"
    path.write_bytes(to_json(kitchen()))
    true = EmbeddedWorld(path)
    return true, SpyWorld(true, lies=True)


def account(spy, object_id):
    things = spy.last_event.metadata["objects"]
    return next(thing for thing in things if thing["objectId"] == object_id)


def test_spy_shows_what_is_in_view_and_lies_about_the_rest(worlds):
    true, spy = worlds
    views = 0
    for thing in true.last_event.metadata["objects"]:
        told = account(spy, thing["objectId"])
        views += thing["visible"]
        assert told["visible"] == thing["visible"]
        assert (told["position"] == thing["position"]) == thing["visible"]
        assert (told["isOpen"] == thing["isOpen"]) == thing["visible"]
    assert 0 < views < len(true.last_event.metadata["objects"])


def test_spy_shows_what_was_in_view_as_it_was_then(worlds):
    true, spy = worlds
    shown = [t for t in spy.last_event.metadata["objects"] if t["visible"]]
    spy.step("RotateRight")
    spy.step("RotateRight")
    hidden = {t["objectId"] for t in true.last_event.metadata["objects"] if not t["visible"]}
    before = [thing for thing in shown if thing["objectId"] in hidden]
    assert before
    for thing in before:
        told = account(spy, thing["objectId"])
        assert told["position"] == thing["position"]
        assert not told["visible"]


@pytest.mark.parametrize(
    ("action", "arguments"),
    [
        ("TeleportFull", {"x": 0, "y": 0.9, "z": 0, "rotation": 0, "horizon": 0, "standing": True}),
        ("GetInteractablePoses", {"objectId": "Mug"}),
        ("PickupObject", {"objectId": "Egg|-01.55|+00.73|-00.20"}),
        ("MoveAhead", {"forceAction": True}),
    ],
)
def test_spy_takes_note_of_what_no_robot_could_do(worlds, action, arguments):
    _, spy = worlds
    spy.step(action, **arguments)
    assert any(offence.startswith(action) for offence in spy.offences)
