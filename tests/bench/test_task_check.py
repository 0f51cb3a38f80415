"""`karma tasks check`: every kind of task that measures nothing is found, and no other."""

import json
from pathlib import Path

import pytest
from support.run_files import karma

from karma.bench.engine import task_check
from karma.bench.engine.task_check import findings
from karma.goals.files import load_tasks, task_lines
from karma.world.sim import EmbeddedWorld

CASES = {  # id -> goals of each sub-task, what is found
    "shut": ([["CLOSED(Fridge)"]], [task_check.TRUE, task_check.IDLE]),
    "no-cd": ([["HOLDON(robot, CD)"]], [task_check.NAMES_NOTHING]),
    "twenty": ([["20*ON(Mug, CounterTop)"]], [task_check.NAMES_NOTHING]),
    "good": ([["INSIDE(Apple, Fridge)"]], []),
    "slices": ([["STATE(AppleSliced, sliced)"], ["INSIDE(Apple, Fridge)"]], []),
}


def _file(folder: Path, names: list[str]) -> Path:
    rows = [
        {
            "id": name, "kind": "simple", "scene": "kitchen_1",
            "subtasks": [{"instruction": "Do it.", "goals": goals} for goals in CASES[name][0]],
        }
        for name in names
    ]  # fmt: skip
    path = folder / "tasks.jsonl"
    path.write_text("\n\n".join(map(json.dumps, rows)))
    return path


@pytest.mark.parametrize("name", CASES)
def test_a_task_is_found_for_what_is_wrong_with_it(name, tmp_path):
    found = list(findings(load_tasks(_file(tmp_path, [name])), EmbeddedWorld))
    assert [one.what for one in found if one.serious] == CASES[name][1]


def test_check_bad_tasks_says_file_line_and_id_and_ends_with_1(tmp_path):
    path = _file(tmp_path, ["good", "shut", "no-cd"])
    assert task_lines(path) == {"good": 1, "shut": 3, "no-cd": 5}
    done = karma("tasks", "check", path, code=1)
    assert f"{path}:3: shut: {task_check.IDLE}" in done
    assert f"{path}:5: no-cd: {task_check.NAMES_NOTHING}" in done
    assert "good:" not in done


def test_check_good_tasks_ends_with_0(tmp_path):
    done = karma("tasks", "check", _file(tmp_path, ["good"]))
    assert "1 tasks, nothing wrong" in done
