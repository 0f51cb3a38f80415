"""Our task files: read strictly; the 48 tasks fit their scenes."""

import json
from collections import Counter

import pytest
from support.paths import ROOT

from karma import registry
from karma.errors import FileError
from karma.goals.files import load_tasks
from karma.goals.goals import GoalTracker, alternatives, object_names, parse_goal
from karma.types.tasks import SubTask
from karma.world.core import scene as scenes

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"


def need(task):
    if not (
        scenes.SCENES / f"{task['scene'] if isinstance(task, dict) else task.scene.source}.json"
    ).exists():
        pytest.skip("the scenes are not made yet")


ROWS = [json.loads(line) for line in TASKS.read_text().splitlines()]
each_task = pytest.mark.parametrize("row", ROWS, ids=[row["id"] for row in ROWS])


def subtask(row):
    return [
        SubTask(instruction=s["instruction"], goals=tuple(parse_goal(g) for g in s["goals"]))
        for s in row["subtasks"]
    ]


# ----------------------------------------------------------------- reading


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A function that writes one task, changed as given, and loads it from its file."""
    monkeypatch.setattr(scenes, "SCENES", tmp_path)
    (tmp_path / "den.json").write_text("{}")

    def load(goal="ON(Book, Sofa)", *, lines=1, **changes):
        one = {"instruction": "Lay the book on the sofa.", "goals": [goal]}
        row = {"id": "t1", "kind": "simple", "scene": "den", "subtasks": [one], **changes}
        path = tmp_path / "tasks.jsonl"
        path.write_text("\n".join([json.dumps(row)] * lines) + "\n")
        return load_tasks(path)

    return load


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"kind": "hard"}, r"\$\.kind"),
        ({"colour": "red"}, "unknown field `colour`"),
        ({"scene": "attic"}, "scene: no scene named 'attic'"),
        ({"subtasks": []}, "subtasks: there are none"),
        ({"subtasks": [{"instruction": "Do it.", "goals": []}]}, r"subtasks\[0\].goals: there are"),
        ({"subtasks": [{"instruction": " ", "goals": ["x"]}]}, r"subtasks\[0\].instruction"),
        ({"subtasks": [{"instruction": "Do it."}]}, r"missing required field `goals`"),
        ({"goal": "ON(Book)"}, r"subtasks\[0\].goals\[0\]: .*ON takes 2"),
        ({"goal": "ON(Bok, Sofa)"}, "Did you mean 'Book'"),
        ({"goal": "INSIDE(Sofa, Book)"}, "lets no Sofa into Book"),
        ({"goal": "STATE(Book, sofa)"}, "unknown state"),
        ({"lines": 2}, "line 2: id: 't1' stands twice"),
    ],
)
def test_load_tasks_of_a_wrong_file_names_line_and_field(small, changes, named):
    with pytest.raises(FileError, match=named) as caught:
        small(**changes)
    assert "tasks.jsonl: line " in str(caught.value)


def test_load_tasks_of_a_torn_or_missing_file_is_refused(tmp_path):
    (tmp_path / "tasks.jsonl").write_text('{"id": "t1", "ki')
    with pytest.raises(FileError, match="line 1"):
        load_tasks(tmp_path / "tasks.jsonl")
    with pytest.raises(FileError, match=r"none\.jsonl"):
        load_tasks(tmp_path / "none.jsonl")


# ----------------------------------------------------------------- the 48 tasks


def test_tasks_are_15_simple_15_composite_18_complex():
    assert Counter(row["kind"] for row in ROWS) == {"simple": 15, "composite": 15, "complex": 18}


def test_tasks_are_half_in_kitchens_and_never_in_a_fourth_scene():
    assert Counter(row["scene"].split("_")[0] for row in ROWS) == {
        "kitchen": 24, "living": 8, "bedroom": 8, "bathroom": 8,
    }  # fmt: skip
    assert {row["scene"].split("_")[1] for row in ROWS} == {"1", "2", "3"}


def test_instructions_are_each_said_once():
    said = Counter(sub["instruction"] for row in ROWS for sub in row["subtasks"])
    assert [text for text, times in said.items() if times > 1] == []


@each_task
def test_task_names_only_what_its_scene_holds(row):
    need(row)
    present = {thing.type for thing in scenes.load(row["scene"]).objects}
    named = {
        part
        for sub in subtask(row)
        for goal in sub.goals
        for name in object_names(goal)
        for part in alternatives(name)
    }
    assert named - present == set()


@each_task
def test_task_is_not_met_before_it_begins(row):
    need(row)
    world = registry.load("worlds", "embedded")()
    tracker = GoalTracker()
    now = world.reset(row["scene"])
    tracker.start(now)
    touched = set()
    for sub in subtask(row):
        names = {name for goal in sub.goals for name in object_names(goal)}
        if not names & touched:
            assert tracker.unmet(sub.goals, now), sub.instruction
        touched |= names
    world.stop()
