"""The authors' own tasks: known by hash, cut and read as `authors.toml` has them."""

import gzip
import json

import pytest

from karma.agent.planning.prompt import render
from karma.errors import FileError
from karma.files import read_toml
from karma.goals.goals import is_position, object_names, parse_goal
from karma.household.types import object_types
from karma.plugins.alfred.published_tasks import READ, load_authors_tasks
from karma.types.planning import PlanRequest

ROW = {"FloorPlan": 7, "ID": 1, "Goal Condition": "ON(cup, table): 1", "Instruction": "Hide a cup."}


@pytest.mark.parametrize(
    ("title", "row", "said"),
    [
        ("EasyTasks", ROW, "EasyTasks"),
        ("SimpleTasks", {"ID": 1}, "FloorPlan"),
        ("SimpleTasks", ROW, "simple-1: none of the authors' tasks"),
        ("SimpleTasks", {**ROW, "ID": 2}, "simple-2: none of the authors' tasks"),
    ],
)
def test_file_of_another_form_or_task_is_refused(tmp_path, title, row, said):
    path = tmp_path / "tasks.json"
    path.write_text(json.dumps({title: [row]}))
    with pytest.raises(FileError, match=said):
        load_authors_tasks([path])


def test_every_goal_is_of_types_that_there_are_and_every_clause_has_its_own():
    tasks = read_toml(READ, dict)["tasks"]
    assert len(tasks) == len({one["sha256"] for one in tasks}) == 25
    for one in tasks:
        assert len(one["goals"]) == len(one["clauses"]), one["id"]
        ends = [end for span in one["clauses"] for end in span]
        assert ends == sorted(ends), one["id"]
        for goals, passing in zip(one["goals"], one.get("passing", one["goals"]), strict=True):
            assert set(passing) <= set(goals)
            for goal in map(parse_goal, goals):
                names = (part for name in object_names(goal) for part in name.split("/"))
                assert {name for name in names if not is_position(name)} <= set(object_types())


@pytest.mark.shared
def test_every_clause_of_the_authors_has_the_whole_request_in_its_prompt(shared):
    tasks = load_authors_tasks(sorted((shared / "data" / "alfred_l").glob("*.json")))
    subtasks = [sub for task in tasks for sub in task.subtasks]
    assert len(subtasks) > 80
    for sub in subtasks:
        request = PlanRequest(instruction=sub.instruction, whole=sub.whole)
        asked = render("full", request).prompt.changing
        assert f"# The user's whole request: {sub.whole}\n" in asked
        assert sub.instruction.split(",")[0] in sub.whole


@pytest.mark.shared
def test_goals_of_the_authors_are_of_types_that_their_rooms_hold(shared):
    present = {}
    with gzip.open(shared / "data" / "thor5" / "scenes.jsonl.gz", "rt") as lines:
        for room in map(json.loads, lines):
            present[room["scene"]] = {thing["objectType"] for thing in room["objects"]}
    seen = 0
    for task in load_authors_tasks(sorted((shared / "data" / "alfred_l").glob("*.json"))):
        here = present[task.scene.name]
        for goal in (goal for sub in task.subtasks for goal in sub.goals):
            for name in object_names(goal):
                wholes = {part.removesuffix("Sliced") for part in name.split("/")}
                assert is_position(name) or wholes & here, (task.id, str(goal))
            seen += 1
    assert seen > 70
