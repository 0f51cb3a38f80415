"""Recordings replayed: what agrees, what differs and why; the real ones of the reference data."""

import gzip
import json
from hashlib import sha256

import pytest
from support.household import find, kitchen

from karma.errors import FileError
from karma.plugins.thor_tools.differences import FLAGS
from karma.plugins.thor_tools.recorded import EventReport, replay_events, scene_of, total_rate
from karma.world.sim import EmbeddedWorld


def record(path, *actions, grid=0.25, start=()):
    """Record our own world, in AI2-THOR's form; returns the steps for tampering."""
    world = EmbeddedWorld(kitchen(), gridSize=grid)
    for action in start:
        world.step(**action(world))
    first = {"action": "Initialize", "gridSize": grid, "sequenceId": 1}
    steps = [{"action": first, "metadata": plain(world)}]
    for number, action in enumerate(actions, 2):
        asked = action(world)
        world.step(**asked)
        steps.append({"action": {**asked, "sequenceId": number}, "metadata": plain(world)})
    return write(path, steps), steps


def plain(world):
    return json.loads(json.dumps({**world.last_event.metadata, "sceneName": "FloorPlan1_physics"}))


def write(path, steps):
    path.write_text("".join(json.dumps(step) + "\n" for step in steps), encoding="utf-8")
    return path


def act(name, kind=None, **arguments):
    def asked(world):
        named = {} if kind is None else {"objectId": find(world, kind)}
        return {"action": name, **named, **arguments}

    return asked


def forced(name, kind):
    return act(name, kind, forceAction=True)


def thing(step, kind):
    return next(o for o in step["metadata"]["objects"] if o["objectType"] == kind)


HOUSEWORK = (
    forced("PickupObject", "Apple"), forced("PutObject", "Bowl"), forced("SliceObject", "Bread"),
    forced("PickupObject", "Mug"), act("RotateRight"), act("MoveAhead"), act("DropHandObject"),
    forced("ToggleObjectOn", "Faucet"), forced("BreakObject", "Plate"), act("Crouch"),
    forced("OpenObject", "Fridge"), forced("PickupObject", "Egg"), act("LookDown"),
)  # fmt: skip


def test_recording_of_our_own_world_replays_without_a_difference(tmp_path):
    path, steps = record(tmp_path / "a.jsonl", *HOUSEWORK)
    report = replay_events(path)
    assert report.differences == ()
    assert (report.steps, report.rate) == (len(HOUSEWORK), 1.0)
    assert report.changes.compared == report.changes.equal > 20
    assert report.compared > len(HOUSEWORK) * len(kitchen().objects) * len(FLAGS)
    assert report.seen.compared == report.motion.compared * 2
    assert len(steps) == report.steps + 1


def test_recording_may_be_gzipped_and_begin_with_something_in_the_hand(tmp_path):
    _, steps = record(
        tmp_path / "a.jsonl", forced("PutObject", "CounterTop"),
        start=(forced("PickupObject", "Apple"),),
    )  # fmt: skip
    assert steps[0]["metadata"]["inventoryObjects"]
    path = tmp_path / "a.jsonl.gz"
    path.write_bytes(gzip.compress((tmp_path / "a.jsonl").read_bytes()))
    assert replay_events(path).differences == ()


def test_scene_has_the_recordings_grid_through_the_agents_place(tmp_path):
    _, steps = record(tmp_path / "a.jsonl", grid=0.1)
    steps[0]["metadata"]["agent"]["position"]["x"] = 0.13
    scene = scene_of(steps[0]["action"], steps[0]["metadata"])
    assert scene.grid_m == 0.1
    assert (0.13, 0.0) in scene.reachable
    assert all(abs((x - 0.13) / 0.1 - round((x - 0.13) / 0.1)) < 1e-6 for x, _ in scene.reachable)


def test_recording_of_several_episodes_begins_anew_at_each(tmp_path):
    _, steps = record(tmp_path / "a.jsonl", forced("PickupObject", "Apple"))
    report = replay_events(write(tmp_path / "b.jsonl", [*steps, *steps]))
    assert (report.steps, report.differences) == (3, ())


def tampered(tmp_path, change, *actions):
    path, steps = record(tmp_path / "a.jsonl", *(actions or (act("Pass"), act("Pass"))))
    change(steps)
    return replay_events(write(path, steps))


def test_flag_that_differs_is_named_with_step_object_and_both_values(tmp_path):
    report = tampered(
        tmp_path,
        lambda steps: thing(steps[2], "Mug").update(isDirty=True),
        act("Pass"), forced("CleanObject", "Plate"),
    )  # fmt: skip
    (found,) = report.differences
    assert (found.step, found.action, found.field) == (2, "CleanObject", "isDirty")
    assert (found.ours, found.theirs) == (False, True)
    assert found.object_id.startswith("Mug|")
    assert report.equal == report.compared - 1
    assert report.changes.equal == report.changes.compared - 1


def test_what_the_simulator_moves_by_itself_is_told_as_jitter_and_still_counts(tmp_path):
    def slide(steps):
        for step in steps[1:]:
            thing(step, "Spoon")["parentReceptacles"] = None
            drawer = thing(step, "Drawer")
            drawer["receptacleObjectIds"] = []

    report = tampered(tmp_path, slide)
    assert report.causes == {"jitter": 4}
    assert report.rate < 1.0


def test_another_outcome_and_what_follows_from_it_are_told(tmp_path):
    def fail(steps):
        steps[1]["metadata"] = json.loads(json.dumps(steps[0]["metadata"]))
        steps[1]["metadata"]["lastActionSuccess"] = False

    report = tampered(tmp_path, fail, forced("PickupObject", "Apple"))
    assert set(report.causes) == {"outcome"}
    assert {d.field for d in report.differences} == {
        "lastActionSuccess", "inventoryObjects", "isPickedUp", "parentReceptacles",
        "receptacleObjectIds",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("[1]", "not a recorded step"),
        ('{"action": {}, "metadata": {}}', "`action`"),
        ('{"action": {"action": "Pass"}, "metadata": {"sceneName": 3}}', "sceneName"),
        ('{"action": {"action": "Initialize"}}', "`metadata`"),
        ('{"action": {"action": "Initialize"}, "metadata"', "not JSON"),
    ],
)
def test_file_that_is_no_recording_is_refused_with_the_place(tmp_path, text, said):
    path = tmp_path / "a.jsonl"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=said):
        replay_events(path)


@pytest.mark.shared
def test_real_recordings_agree_with_the_embedded_world(shared):
    reports = [replay_events(p) for p in sorted(shared.glob("data/thor5/events/*.jsonl.gz"))]
    assert reports and all(isinstance(report, EventReport) for report in reports)
    assert total_rate(reports) >= 0.995
    assert min(report.rate for report in reports) >= 0.995
    assert all(cause == "jitter" for report in reports for cause in report.causes)


@pytest.mark.shared
@pytest.mark.parametrize("half", [0, 1])
def test_what_real_actions_changed_changes_alike_in_either_half_of_the_recordings(shared, half):
    """Halves by a hash of the name, so that what is mended in one is measured in the other."""
    paths = sorted(shared.glob("data/thor5/events/*.jsonl.gz"))
    mine = [p for p in paths if sha256(p.name.partition(".")[0].encode()).digest()[-1] % 2 == half]
    changes = [replay_events(path).changes for path in mine]
    assert mine
    assert sum(one.equal for one in changes) >= 0.97 * sum(one.compared for one in changes)
