"""Scenes built from ALFRED's trials, and what lies in what there."""

import json

import pytest
from support import alfred_kitchen as ours

from karma.plugins.alfred.replay.build import build, contained
from karma.plugins.alfred.replay.facts import Files, gather
from karma.plugins.alfred.replay.steps import visited
from karma.world.core.boxes import Box

APPLE, FRIDGE, TABLE = ours.APPLE, ours.FRIDGE, ours.TABLE


@pytest.fixture
def side(tmp_path):
    return ours.beside(tmp_path)


def scene_of(tmp_path, trial, files=None):
    record = ours.read(tmp_path, trial)
    scene = build(record, gather([record], files or Files())[ours.PLAN])
    return {thing.id: thing for thing in scene.objects}


# ----------------------------------------------------------------- scenes


def test_build_has_the_trials_poses_ids_start_and_cells(tmp_path, side):
    record = ours.read(tmp_path, ours.trial())
    scene = build(record, gather([record], side)[ours.PLAN])
    by_id = {thing.id: thing for thing in scene.objects}
    assert by_id[APPLE].position == (1.4, 0.81, -0.5)
    assert by_id[APPLE].parents == (TABLE,)
    assert scene.rules == "thor-2.1.0"
    assert scene.agent.position == (0.0, 0.9, 0.0)
    assert scene.agent.horizon == 30
    assert set(visited(record)) <= set(scene.reachable)
    assert set(map(tuple, ours.layout()[ours.PLAN]["reachable"])) <= set(scene.reachable)
    assert [thing.type for thing in scene.objects].count("Apple") == 1


def test_build_keeps_the_trials_id_and_takes_the_dumps_box(tmp_path, side):
    trial = ours.trial()
    text = json.dumps(trial).replace(FRIDGE, "Fridge|-01.60|+00.88|-00.25")
    text = text.replace(
        "[-6.6, -6.6, -0.8, -0.8, 3.6, 3.6]", "[-6.4, -6.4, -1.0, -1.0, 3.52, 3.52]"
    )
    by_id = scene_of(tmp_path, json.loads(text), side)
    fridge = by_id["Fridge|-01.60|+00.88|-00.25"]
    assert fridge.size == (0.6, 1.8, 0.8)
    assert fridge.center == pytest.approx((-1.6, 0.88, -0.25), abs=0.011)
    assert FRIDGE not in by_id


def test_build_a_moved_object_has_its_shape_and_a_renamed_one_its_box(tmp_path, side):
    trial = ours.trial()
    far, desk = "GarbageCan|+01.00|+00.20|+01.00", "Desk|+01.65|+00.40|-00.40"
    trial["plan"]["low_actions"] += ours.low(4, ours.on("OpenObject", far))
    trial["plan"]["low_actions"] += ours.low(4, ours.on("OpenObject", desk))
    text = json.dumps(trial).replace('"DiningTable"', '"Desk"')
    by_id = scene_of(tmp_path, json.loads(text), side)
    assert by_id[far].size == (0.3, 0.4, 0.3)
    assert by_id[far].center == pytest.approx((1.0, 0.2, 1.0))
    assert [one for one in by_id if one.startswith("GarbageCan")] == [far]
    assert by_id[desk].type == "Desk"
    assert by_id[desk].size == (0.8, 0.8, 1.4)
    assert TABLE not in by_id


def test_build_turns_a_models_box_as_the_trial_has_it_also_on_end(tmp_path, side):
    trial = ours.trial()
    (knife,) = [t for t in trial["scene"]["object_poses"] if t["objectName"] == "Knife_1"]
    flat = scene_of(tmp_path, trial, side)[ours.KNIFE]
    knife["rotation"]["x"] = 90
    stood = scene_of(tmp_path, trial, side)[ours.KNIFE]
    assert flat.size == pytest.approx((0.05, 0.02, 0.2))
    assert stood.size == pytest.approx((0.05, 0.2, 0.02))
    assert stood.position == flat.position


@pytest.mark.parametrize(("types", "inferred"), [((), True), (("Sink",), True), (("Mug",), False)])
def test_build_a_sink_is_inferred_from_its_basin_unless_the_rooms_types_lack_it(
    tmp_path, types, inferred
):
    sink = "Sink|+00.10|+00.90|+01.15"
    trial = ours.trial()
    trial["plan"]["low_actions"] += ours.low(4, ours.put(APPLE, f"{sink}|SinkBasin"))
    layouts = tmp_path / "layouts.json"
    layouts.write_text(json.dumps({ours.PLAN: {"reachable": [], "object_types": types}}))
    by_id = scene_of(tmp_path, trial, Files(layouts=layouts))
    assert (sink in by_id) == inferred
    if inferred:
        whole, basin = Box.around(by_id[sink].center, by_id[sink].size), by_id[f"{sink}|SinkBasin"]
        assert by_id[sink].inferred
        assert by_id[sink].type == "Sink"
        assert not basin.inferred
        assert whole.grown(0.01, 0.01, 0.01).overlaps(Box.around(basin.center, basin.size))


def test_build_dirty_and_empty_and_toggles_are_the_trials(tmp_path, side):
    trial = ours.trial()
    trial["scene"]["dirty_and_empty"] = True
    trial["scene"]["object_poses"].append(ours.pose("Mug_1", (-0.4, 0.9, 1.05)))
    trial["scene"]["object_toggles"] = [{"objectType": "LightSwitch", "isOn": False}]
    by_type = {thing.type: thing for thing in scene_of(tmp_path, trial, side).values()}
    assert by_type["Mug"].is_dirty
    assert not by_type["Mug"].is_filled
    assert not by_type["LightSwitch"].is_toggled


def test_build_old_types_get_new_names_and_unknown_ones_are_left_out(tmp_path, side):
    trial = ours.trial()
    trial["scene"]["object_poses"] += [
        ours.pose("Glassbottle_1", (-0.4, 0.9, 1.05)), ours.pose("Gizmo_1", (0.1, 0.9, 1.05)),
    ]  # fmt: skip
    by_id = scene_of(tmp_path, trial, side)
    assert by_id["Glassbottle|-00.40|+00.90|+01.05"].type == "Bottle"
    assert not [one for one in by_id if one.startswith("Gizmo")]


# ----------------------------------------------------------------- what lies in what


def guessed(tmp_path, trial, files):
    record = ours.read(tmp_path, trial)
    facts = gather([record], files)[ours.PLAN]
    things = build(record, facts).objects
    poses = {pose.id for pose in record.scene.object_poses}
    fixed = [thing for thing in things if thing.id not in poses]
    return contained(record, facts, fixed, [thing for thing in things if thing.id in poses])


def test_contained_by_label_by_box_and_not_at_all(tmp_path, side):
    trial = ours.trial()
    trial["scene"]["object_poses"].append(ours.pose("Pen_1", (0.0, 0.01, -0.5)))
    found = guessed(tmp_path, trial, side)
    assert found[APPLE] == TABLE
    assert found[ours.KNIFE] == TABLE
    assert found["Egg|-01.55|+00.70|-00.20"] == FRIDGE
    assert "Pen|+00.00|+00.01|-00.50" not in found


def test_contained_a_spoon_against_a_cup_is_in_it(tmp_path, side):
    trial = ours.trial()
    trial["scene"]["object_poses"] += [
        ours.pose("Cup_1", (1.8, 0.81, 0.1)), ours.pose("Spoon_1", (1.8, 0.81, 0.18)),
        ours.pose("Fork_1", (1.5, 0.81, -0.1)),
    ]  # fmt: skip
    found = guessed(tmp_path, trial, side)
    assert found["Spoon|+01.80|+00.81|+00.18"] == "Cup|+01.80|+00.81|+00.10"
    assert found["Fork|+01.50|+00.81|-00.10"] == TABLE


def test_contained_what_was_picked_up_was_not_behind_a_shut_door(tmp_path, side):
    trial = json.loads(json.dumps(ours.trial()).replace('"DiningTable"', '"Cabinet"'))
    spot = ours.spot("Cabinet", (-0.5, 0.4, 0.95))
    trial["plan"]["high_pddl"][1]["planner_action"]["coordinateReceptacleObjectId"] = spot
    assert guessed(tmp_path, trial, side)[APPLE] == TABLE


def test_contained_labels_of_other_trials_vote(tmp_path, side):
    spots = [[1.0, 0.9, 1.0, "Microwave|-01.20|+01.05|+01.25", f"other_{n}", "x"] for n in range(2)]
    spots += [[1.05, 0.9, 1.0, TABLE, "other_9", "x"], [1.0, 2.5, 1.0, TABLE, "other_8", "x"]]
    path = tmp_path / "spots.json"
    path.write_text(json.dumps({"spots": {ours.PLAN: spots}, "type_band": {}}))
    trial = ours.trial()
    trial["scene"]["object_poses"].append(ours.pose("Cup_1", (1.02, 0.9, 1.0)))
    known = {thing["objectId"] for thing in ours.dump()["objects"]}
    assert "Microwave|-01.20|+01.05|+01.25" in known
    files = Files(dumps=side.dumps, spots=path)
    assert guessed(tmp_path, trial, files)["Cup|+01.02|+00.90|+01.00"] == spots[0][3]
