"""scripts/export_thor_scenes.py, run as a lab runs it, on the player instead of Unity.

Covered: what it writes is what this project imports, to the last field; recordings replay without a
difference; a run that was cut off goes on; failures are told.
"""

import json
import subprocess
import sys

import msgspec
import pytest
from support import fake_player
from support.household import kitchen, thing
from support.paths import ROOT

from karma.files import to_json
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.thor_tools.player import command
from karma.plugins.thor_tools.recorded import read_events, replay_events
from karma.world.core.scene import load
from karma.world.sim import EmbeddedWorld

pytest.importorskip("ai2thor", reason="needs the package ai2thor")

SCRIPT = ROOT / "scripts" / "export_thor_scenes.py"
OF_THE_POSE = ("visible", "isInteractable", "distance")


@pytest.fixture
def scenes(tmp_path):
    """A folder with two rooms, named as AI2-THOR names kitchens."""
    folder = tmp_path / "scenes"
    folder.mkdir()
    for name, extra in (("FloorPlan1", ()), ("FloorPlan12", [thing("Chair", (0.9, 0.4, -1.6))])):
        room = msgspec.structs.replace(kitchen(extra), name=name)
        (folder / f"{name}.json").write_bytes(to_json(room))
    return folder


@pytest.fixture
def export(tmp_path, scenes):
    """Run the script; returns the finished process."""

    def run(*arguments, executable=None):
        words = [sys.executable, SCRIPT, tmp_path / "out", "--headless", *arguments]
        words += ["--executable", executable or command(scenes)]
        done = subprocess.run(
            list(map(str, words)), capture_output=True, text=True, timeout=120, check=False
        )
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return run


def rows(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def without_pose(objects):
    return [{k: v for k, v in one.items() if k not in OF_THE_POSE} for one in objects]


def test_exported_scenes_import_to_equal_objects(export, tmp_path, scenes):
    out = tmp_path / "out"
    assert export("--only", "FloorPlan*").returncode == 0
    dumped = {row["scene"]: row for row in rows(out / "scenes.jsonl")}
    assert list(dumped) == ["FloorPlan1", "FloorPlan12"]
    back = import_dump(out / "scenes.jsonl", layouts=out / "layouts.json")
    for scene, number in zip(back, (1, 12), strict=True):
        row = dumped[scene.name]
        original = load(scenes / f"FloorPlan{number}.json")
        truth = EmbeddedWorld(original).last_event.metadata
        assert row["objects"] == json.loads(json.dumps(truth["objects"]))
        assert row["agent"]["position"] == truth["agent"]["position"]
        assert row["bounds"] == json.loads(json.dumps(truth["sceneBounds"]))
        again = EmbeddedWorld(scene).last_event.metadata["objects"]
        assert without_pose(again) == without_pose(truth["objects"])
        assert scene.reachable == tuple(sorted(original.reachable))


def test_recorded_actions_replay_without_a_difference(export, tmp_path, scenes):
    out = tmp_path / "out"
    world = EmbeddedWorld(load(scenes / "FloorPlan1.json"))
    ids = {o["objectType"]: o["objectId"] for o in world.last_event.metadata["objects"]}
    forced = {"forceAction": True}
    actions = [
        {"action": "OpenObject", "objectId": ids["Fridge"], **forced},
        {"action": "PickupObject", "objectId": ids["Apple"], **forced},
        {"action": "PutObject", "objectId": ids["Fridge"], **forced},
        {"action": "CloseObject", "objectId": ids["Fridge"], **forced},
        {"action": "PickupObject", "objectId": ids["Mug"], **forced},
        {"action": "PickupObject", "objectId": ids["Egg"], **forced},  # the hand is full
        {"action": "DropHeldObject"},
        {"action": "SliceObject", "objectId": ids["Bread"], **forced},
        {"action": "ToggleObjectOn", "objectId": ids["StoveKnob"], **forced},
        {"action": "NoSuchAction"},
        {"action": "RotateRight"},
        {"action": "LookDown"},
    ]
    script = tmp_path / "fridge.json"
    script.write_text(
        json.dumps({"scene": "FloorPlan1", "initialize": {"gridSize": 0.25}, "actions": actions})
    )
    assert export("--only", "FloorPlan1").returncode == 0
    done = export("--record", script)
    assert done.returncode == 0, done.stderr
    path = out / "events" / "fridge.jsonl"
    steps = read_events(path)
    assert [action["action"] for action, _ in steps] == [
        "Initialize", *(action["action"] for action in actions)
    ]  # fmt: skip
    assert steps[0][0] == {"action": "Initialize", "gridSize": 0.25, "sequenceId": 1}
    failed = [a["action"] for a, m in steps if not m["lastActionSuccess"]]
    assert failed == ["PickupObject", "NoSuchAction"]
    report = replay_events(path, layouts=out / "layouts.json")
    assert report.differences == ()
    assert report.equal == report.compared > 1000
    assert report.changes.compared > 5


def test_player_that_dies_in_one_scene_is_started_again_for_it(tmp_path, export):
    dying = fake_player.command("die@GetReachablePositions", once=tmp_path / "once")
    done = export(executable=dying)
    assert done.returncode == 1
    assert "FloorPlan1_physics: the simulator is lost" in done.stderr
    assert [row["scene"] for row in rows(tmp_path / "out" / "scenes.jsonl")] == ["FloorPlan2"]
    assert export(executable=dying).returncode == 0
    names = [row["scene"] for row in rows(tmp_path / "out" / "scenes.jsonl")]
    assert names == ["FloorPlan2", "FloorPlan1"]
