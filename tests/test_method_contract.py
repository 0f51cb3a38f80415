"""What every method must do, whatever row it is: to be registered is to be tested."""

import pytest

from karma import registry
from karma.bench.episode import run_episode
from karma.contracts import Outcome, Plan, SkillResult, SubTask, Task
from karma.errors import KarmaError
from karma.files import to_json
from karma.goals import parse_goal
from karma.infer.metadata_vision import MetadataVision
from karma.infer.scripted import ScriptedModel
from karma.methods.kit import Kit
from karma.planner import Planner
from karma.world.sim import EmbeddedWorld

METHODS = registry.names("methods")
SCENE = "kitchen_1"
GOALS = ("INSIDE(Apple, Fridge)", "HOLDON(robot, Mug)")
FETCH = (
    "Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n"
)
ANSWERS = [FETCH, "Fly(robot)", *["GoToObject(robot, 'Fridge')\n"] * 40]
TASK = Task(
    id="t1",
    kind="composite",
    scene=SCENE,
    subtasks=tuple(
        SubTask(instruction=text, goals=(parse_goal(goal),))
        for text, goal in zip(("Put the apple away.", "Fetch the mug."), GOALS, strict=True)
    ),
)

pytestmark = pytest.mark.parametrize("name", METHODS)


def build(name, options=None):
    kit = Kit(
        planner=Planner(ScriptedModel(ANSWERS), "compact"),
        recall=registry.load("recalls", "cosine")(registry.load("embedders", "minilm")()),
        vision=MetadataVision(),
    )
    return registry.load("methods", name).build(kit, options or {})


def begun(name, folder):
    method, world = build(name), EmbeddedWorld(SCENE)
    method.begin(world, SCENE, seed=0, folder=folder)
    return method, world


def records(name, folder):
    """Two episodes of one method, as bytes, without the times."""
    method, world = build(name), EmbeddedWorld()
    found = [
        run_episode(method, world, TASK, row=name, seed=seed, folder=folder) for seed in (0, 1)
    ]
    return [timeless(record) for record in found]


def timeless(record):
    return to_json(record)


def test_do_yields_its_outcome_last_and_once(name, tmp_path):
    method, world = begun(name, tmp_path)
    for subtask in TASK.subtasks:
        *before, last = method.do(subtask)
        assert isinstance(last, Outcome)
        assert all(isinstance(moment, Plan | SkillResult) for moment in before)
        there = {thing["objectId"] for thing in world.last_event.metadata["objects"]}
        assert set(last.handled_ids) <= there


def test_do_before_begin_is_refused(name):
    method = build(name)
    with pytest.raises(RuntimeError, match="begin"):
        list(method.do(TASK.subtasks[0]))


def test_begin_leaves_the_world_as_the_scene_has_it(name, tmp_path):
    _, world = begun(name, tmp_path)
    assert things(world) == things(EmbeddedWorld(SCENE))


def things(world):
    seen_from = ("visible", "isInteractable", "distance")
    metadata = world.last_event.metadata
    return metadata["agent"], [
        {key: value for key, value in thing.items() if key not in seen_from}
        for thing in metadata["objects"]
    ]


def test_equal_inputs_give_equal_records(name, tmp_path):
    assert records(name, tmp_path / "a") == records(name, tmp_path / "b")


def test_goals_are_read_by_the_oracle_only(name, tmp_path):
    moments = []
    for goals in (True, False):
        method, _ = begun(name, tmp_path)
        moments.append(
            [
                moment
                for subtask in TASK.subtasks
                for moment in method.do(
                    SubTask(instruction=subtask.instruction, goals=subtask.goals if goals else ())
                )
            ]
        )
    assert (moments[0] == moments[1]) == (name != "oracle")


def test_unknown_option_is_refused_by_name(name):
    with pytest.raises(KarmaError, match="unknown option 'colour'"):
        build(name, {"colour": "red"})


def test_method_has_a_name_for_the_table(name):
    assert build(name).name
