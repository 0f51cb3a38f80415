"""LoTa-Bench's ALFRED over the kitchen of tests/support/alfred_kitchen.py."""

from karma.plugins.alfred.eb_world.actions import LOTA_ALFRED
from karma.plugins.alfred.eb_world.environment import Environment
from karma.plugins.alfred.published_tasks import ListedTask
from support import alfred_kitchen as ours
from support import eb_alfred as eb

SAID = "put some fruit into the fridge"
FETCH = ("find an apple", "pick up the apple")
STOW = ("find a fridge", "open the fridge", "put down the apple")


def trial():
    """Our demonstration, and what someone said of it."""
    return ours.trial() | {"turk_annotations": [{"task_desc": SAID, "high_descs": []}]}


def listed(name="ours_1", *, instruction="", repeat=0):
    folder = "pick_and_place_simple-Apple-None-Fridge-7"
    return ListedTask(
        list="valid_seen", position=0, folder=folder, trial=name, repeat=repeat,
        instruction=instruction,
    )  # fmt: skip


def environment(folder, *, more=(), task="", strict=False):
    found = eb.rooms(folder, more=more, task=task)
    (trial,) = found.trials.values()
    facts = found.facts[trial.scene.floor_plan]
    return Environment(trial, facts, eb.TYPES, protocol=LOTA_ALFRED, strict=strict)
