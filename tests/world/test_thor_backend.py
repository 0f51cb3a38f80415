"""The AI2-THOR backend while all goes well: launch, manners, pictures, and what it never does.

The player is a scripted one (fake_player.py), the client AI2-THOR's own.
"""

import os
import shlex
import sys

import numpy as np
import pytest
from support import fake_player

from karma.errors import FileError, KarmaError, UnknownNameError

pytest.importorskip("ai2thor", reason="needs the package ai2thor")

import ai2thor.build
import ai2thor.downloader
from ai2thor.controller import Controller
from ai2thor.server import Event

from karma.world.thor.backend import ThorWorld
from karma.world.thor.client import Client

BLINDS, MUG = "Blinds|+00.00|+01.00|+00.00", "Mug|+01.00|+01.00|+00.00"


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    return tmp_path


@pytest.fixture
def world(home):
    made = ThorWorld(fake_player.command(), scene="FloorPlan1")
    yield made
    made.stop()


def environment(world):
    return world.step("Environment").metadata["actionReturn"]


def test_events_are_the_clients_own(world):
    event = world.step("Pass")
    assert isinstance(event, Event)
    assert event is world.last_event
    assert event.metadata["sceneName"] == "FloorPlan1_physics"
    assert world.scenes == ("FloorPlan1_physics", "FloorPlan2_physics")


def test_pictures_can_be_written_and_lie_in_one_piece(world):
    first, second = world.step("Pass"), world.step("Pass")
    assert first.frame.flags["C_CONTIGUOUS"]
    kept = second.frame.copy()
    first.frame[:] = 0
    assert np.array_equal(second.frame, kept)
    assert second.frame[-1, 0].tolist() == [0, 1, 2]  # the first bytes are the lower left corner


def test_failure_raises_when_asked_to(home):
    world = ThorWorld(fake_player.command("refuse@MoveAhead"), scene="FloorPlan1")
    assert not world.step("MoveAhead")
    with pytest.raises(RuntimeError, match="not like this"):
        world.step("MoveAhead", raise_for_failure=True)
    assert world.last_event.metadata["lastAction"] == "MoveAhead"
    assert world.step("Pass")
    world.stop()


def test_misuse_is_a_value_error_and_the_world_goes_on(world):
    with pytest.raises(ValueError, match="no"):
        world.step("Bad")
    assert world.last_event.metadata["errorCode"] == "InvalidAction"
    with pytest.raises(TypeError):
        world.step("Echo", thing=object())
    assert world.step("Pass")


def test_unknown_scene_is_named_with_the_nearest_and_the_world_goes_on(world):
    with pytest.raises(UnknownNameError, match="FloorPlan2_physics"):
        world.reset("FloorPlan22")
    assert world.reset("FloorPlan2").metadata["sceneName"] == "FloorPlan2_physics"


def test_size_and_settings_reach_the_player(home):
    world = ThorWorld(fake_player.command(), width=320, height=240, gridSize=0.1)
    event = world.reset("FloorPlan1")
    assert event.frame.shape == (240, 320, 3)
    assert event.metadata["actionReturn"]["gridSize"] == 0.1
    world.stop()


@pytest.mark.parametrize("name", ["branch", "commit_id", "local_build", "download_only"])
def test_arguments_that_look_for_a_build_are_refused(name, home):
    with pytest.raises(TypeError, match=name):
        ThorWorld(fake_player.command(), **{name: "x"})


def test_refusal_to_begin_is_a_clear_error(home):
    world = ThorWorld(fake_player.command("refuse@Initialize"))
    with pytest.raises(KarmaError, match="refuses to begin: not like this"):
        world.reset("FloorPlan1")


# ----------------------------------------------------------------- blinds


@pytest.mark.parametrize(
    "given",
    [
        {"action": "OpenObject", "objectId": BLINDS},
        {"action": "CloseObject", "objectId": BLINDS, "forceAction": True},
    ],
)
def test_blinds_are_refused_as_a_value_and_never_sent(given, home):
    world = ThorWorld(fake_player.command("die@OpenObject"), scene="FloorPlan1")
    before = world.last_event.metadata
    event = world.step(given)
    assert not event
    assert "Blinds" in event.metadata["errorMessage"]
    assert event.metadata["lastAction"] == given["action"]
    assert event.metadata["objects"] == before["objects"]
    assert world.last_event is event
    assert before["lastActionSuccess"]
    with pytest.raises(RuntimeError, match="Blinds"):
        world.step(given, raise_for_failure=True)
    assert world.last_event.metadata["errorMessage"] == event.metadata["errorMessage"]
    assert world.step("Pass")
    world.stop()


# ----------------------------------------------------------------- launch


def test_graphics_card_variable_is_taken_out_of_the_launch_only(home, monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    monkeypatch.setenv("PATH", str(home))  # where no vulkaninfo is
    world = ThorWorld(fake_player.command(), scene="FloorPlan1")
    assert "CUDA_VISIBLE_DEVICES" not in environment(world)
    assert os.environ["CUDA_VISIBLE_DEVICES"] == "0"
    world.stop()


def test_folder_that_cannot_be_written_is_named(home):
    (home / "file").touch()
    world = ThorWorld(fake_player.command(), folder=home / "file")
    with pytest.raises(FileError, match="HOME"):
        world.reset("FloorPlan1")


def test_nothing_is_looked_up_or_fetched(home, monkeypatch):
    def never(*_arguments, **_named):
        raise AssertionError("the client looks for a build")

    for owner, name in (
        (Controller, "find_build"), (Controller, "_branch_commits"), (Controller, "local_commits"),
        (ai2thor.build.Build, "exists"), (ai2thor.build.Build, "zipfile"),
        (ai2thor.downloader, "download"),
    ):  # fmt: skip
        monkeypatch.setattr(owner, name, never)
    with pytest.raises(KarmaError, match="no Unity build"):
        ThorWorld()
    command = shlex.split(fake_player.command())
    client = Client(
        pytest.fail, command=command, platform="Linux64", folder=home, x_display=":0",
        scene="FloorPlan1",
    )  # fmt: skip
    assert client.step("Pass")
    client._lost = lambda _reason: None
    client.stop()


def test_missing_package_is_named_with_the_command(home, monkeypatch):
    monkeypatch.setattr(sys, "path", [])
    with pytest.raises(KarmaError, match=r"ai2thor.*\n.*pip install"):
        ThorWorld(fake_player.command())
