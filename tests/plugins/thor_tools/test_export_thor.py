"""scripts/export_thor_scenes.py, run as a lab runs it, on the player instead of Unity.

Covered: what it writes is what this project imports, to the last field; recordings replay without a
difference; a run that was cut off goes on; failures are told.
"""

import json
import subprocess
import sys

import msgspec
import pytest
from export_thor_scenes import chosen
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


def test_second_run_goes_on_where_the_first_was_cut_off(export, tmp_path):
    path = tmp_path / "out" / "scenes.jsonl"
    export("--only", "FloorPlan1")
    first = path.read_bytes()
    path.write_bytes(first + b'{"scene": "FloorPlan12", "obj')  # torn
    export("--only", "FloorPlan*")
    assert path.read_bytes().startswith(first)
    assert [row["scene"] for row in rows(path)] == ["FloorPlan1", "FloorPlan12"]
    layouts = json.loads((tmp_path / "out" / "layouts.json").read_text())
    assert sorted(layouts) == ["FloorPlan1", "FloorPlan12"]
    whole = path.read_bytes()
    export("--only", "FloorPlan*")
    assert path.read_bytes() == whole


def test_recording_that_is_there_is_not_done_again(export, tmp_path):
    script = tmp_path / "look.json"
    script.write_text(json.dumps({"scene": "FloorPlan1", "actions": [{"action": "LookUp"}]}))
    export("--record", script)
    path = tmp_path / "out" / "events" / "look.jsonl"
    path.write_text("kept")
    assert "is there already" in export("--record", script).stdout
    assert path.read_text() == "kept"


def test_player_that_dies_in_one_scene_is_started_again_for_it(tmp_path, export):
    dying = fake_player.command("die@GetReachablePositions", once=tmp_path / "once")
    done = export(executable=dying)
    assert done.returncode == 1
    assert "FloorPlan1_physics: the simulator is lost" in done.stderr
    assert [row["scene"] for row in rows(tmp_path / "out" / "scenes.jsonl")] == ["FloorPlan2"]
    assert export(executable=dying).returncode == 0
    names = [row["scene"] for row in rows(tmp_path / "out" / "scenes.jsonl")]
    assert names == ["FloorPlan2", "FloorPlan1"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--only", "FloorPlan77"], "no such scene"),
        (["--record", "/no/such/script.json"], "No such file"),
        (["--executable", "/no/such/build"], "no such executable"),
    ],
)
def test_what_cannot_be_is_told(arguments, said, tmp_path, scenes):
    words = [sys.executable, SCRIPT, tmp_path / "out", "--executable", command(scenes), *arguments]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "text", ["[]", "{", '{"scene": "FloorPlan1"}', '{"scene": "FloorPlan1", "actions": [{}]}']
)
def test_script_of_the_wrong_form_is_refused_with_its_name(text, tmp_path, export):
    script = tmp_path / "wrong.json"
    script.write_text(text)
    done = export("--record", script)
    assert done.returncode == 1
    assert "wrong.json" in done.stderr


def test_scenes_of_other_robots_are_left_out_unless_named():
    names = ["FloorPlan10_physics", "FloorPlan2_physics", "FloorPlan_Train1_1", "Procedural"]
    assert chosen(names, None) == ["FloorPlan2_physics", "FloorPlan10_physics"]
    assert chosen(names, ["FloorPlan_Train*", "FloorPlan2"]) == [
        "FloorPlan2_physics", "FloorPlan_Train1_1"
    ]  # fmt: skip
