"""LoTa-Bench's ALFRED over the kitchen of tests/support/alfred_kitchen.py."""

from karma.world.eb_alfred.environment import Environment
from karma.world.eb_alfred.protocol import LOTA_ALFRED
from support import eb_alfred as eb


def environment(folder, *, more=(), task="", strict=False):
    found = eb.rooms(folder, more=more, task=task)
    (trial,) = found.trials.values()
    facts = found.facts[trial.scene.floor_plan]
    return Environment(trial, facts, eb.TYPES, protocol=LOTA_ALFRED, strict=strict)
