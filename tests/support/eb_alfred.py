"""EB-ALFRED over the kitchen of tests/support/alfred_kitchen.py, with lists of types of our own."""

import json

from karma.agent.journal.header import EPISODES, RESULTS, TABLE
from karma.bench.suites.alfred.benchmark import TrialRooms, read_rooms
from karma.bench.suites.alfred.experiment import read_tasks
from karma.bench.suites.alfred.players import ExpertPlayer
from karma.world.alfred.facts import gather
from karma.world.eb_alfred.actions import ActionTypes, read_types
from karma.world.eb_alfred.environment import Environment
from support import alfred_kitchen as ours
from support.paths import SHARED

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


def say(env, *names):
    """Do actions by their names; return the last step."""
    numbers = {str(action): number for number, action in enumerate(env.actions)}
    return [env.step(numbers[name]) for name in names][-1]


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


def shared_half():
    """The half's tasks, the rooms, and the lists of types; who asks is marked `shared`."""
    lists, trials = SHARED / "data/eb_alfred", SHARED / "data/alfred/valid_seen.jsonl.gz"
    tasks = read_tasks(lists / "splits_even.json")
    return tasks, read_rooms(trials), read_types(lists / "action_types.json")


def expert_result(trial, facts, types, *, strict=False):
    """Whether the demonstration's plan reaches the goal, and what was refused on the way."""
    env = played(ExpertPlayer(), Environment(trial, facts, types, strict=strict))
    return env.end == "goal met", [(step.name, step.feedback) for step in env.steps if not step.ok]


def run_files(folder):
    """All that must be the same in every run."""
    return {name: (folder / name).read_bytes() for name in (EPISODES, RESULTS, TABLE)}
