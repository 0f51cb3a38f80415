"""EB-ALFRED over the kitchen of tests/support/alfred_kitchen.py, with lists of types of our own."""

import json

import pytest

from karma.bench.engine.run import Run
from karma.journal.folder import EPISODES, RESULTS, TABLE
from karma.plugins.alfred.eb_world.actions import ActionTypes
from karma.plugins.alfred.eb_world.environment import Environment
from karma.plugins.alfred.replay.facts import gather
from karma.plugins.alfred.suites.benchmark import TrialRooms
from support import alfred_kitchen as ours

TYPES = ActionTypes(
    objs=("Apple", "Egg", "Knife", "Fridge", "DiningTable", "Drawer", "Pen"),
    pick_obj=("Apple", "Egg", "Knife", "Pen"),
    open_obj=("Fridge", "Drawer"),
    toggle_obj=("Faucet",),
    slice_obj=("Apple",),
)


ROWS = """
[[rows]]
name = "expert"
player = "expert"
[[rows]]
name = "expert (strict)"
player = "expert"
strict = true
[[rows]]
name = "chance"
player = "chance"
"""


def types_file(folder):
    path = folder / "types.json"
    path.write_text(
        json.dumps({f"alfred_{k}": list(getattr(TYPES, k)) for k in TYPES.__struct_fields__})
    )
    return path


def rooms(folder, *, more=(), task=""):
    """Our trial's room; `more` are other poses of things, `task` another type of task."""
    given = ours.trial()
    given["task_type"] = task or given["task_type"]
    given["scene"]["object_poses"] += more
    trial = ours.read(folder, given)
    return TrialRooms(trials={trial.id: trial}, facts=gather([trial], ours.beside(folder)))


def environment(folder, *, more=(), strict=False, puts=None):
    found = rooms(folder, more=more)
    (trial,) = found.trials.values()
    facts = found.facts[trial.scene.floor_plan]
    return Environment(trial, facts, TYPES, strict=strict, puts=puts)


def played(player, env):
    """The environment after a player has played it to its end."""
    while not env.end:
        plan = player.plan(env)
        if not plan:
            env.give_up()
            break
        for number in plan:
            if not env.step(number).ok or env.end:
                break
    return env


def say(env, *names):
    """Do actions by their names; return the last step."""
    numbers = {str(action): number for number, action in enumerate(env.actions)}
    return [env.step(numbers[name]) for name in names][-1]


def hosted(url, *rows):
    """Rows of an experiment that ask one hosted model."""
    return "".join(f"[[rows]]\n{row}\n" for row in rows) + (
        '[models]\nplanner = "openai"\n[models.hosted.planner]\n'
        f'base_url = "{url}"\nmodel = "m"\ndialect = "plain"\nretries = 0\n'
    )


def finished(path, folder, workers=1, **more):
    """The records of an experiment's run, and its files."""
    run = Run(path, folder, **more)
    return list(run.episodes(workers)), run_files(folder)


def run_files(folder):
    """All that must be the same in every run."""
    return {name: (folder / name).read_bytes() for name in (EPISODES, RESULTS, TABLE)}


@pytest.fixture
def experiment(tmp_path, monkeypatch):
    """A function that writes an experiment over our kitchen and returns its path."""
    monkeypatch.setenv("KARMA_SHARED", str(ours.reference(tmp_path / "ref")))
    types, trials = types_file(tmp_path), ours.write(tmp_path / "trials.jsonl", ours.trial())
    published = tmp_path / "published.csv"
    published.write_text("model,subset,score\nDeep Thought,average,42\nDeep Thought,base,41.5\n")

    def write(rows=ROWS, *, tasks=None, **changed):
        lists = {
            "base": [("ours_1", "Put the apple into the fridge."), ("ours_1", "Cool some fruit.")],
            "spatial": [("ours_1", "The apple goes into the fridge."), ("ours_1", "Chill it.")],
        }
        given = {
            name: [
                {"task": f"x/{one}", "repeat_idx": 0, "instruction": text} for one, text in found
            ]
            for name, found in (tasks or lists).items()
        }
        (tmp_path / "splits.json").write_text(json.dumps(given))
        fields = {
            "name": "x", "benchmark": "eb_alfred", "tasks": str(tmp_path / "splits.json"),
            "types": str(types), "trials": str(trials), "published": str(published), **changed,
        }  # fmt: skip
        path = tmp_path / "x.toml"
        path.write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in fields.items()) + rows)
        return path

    return write
