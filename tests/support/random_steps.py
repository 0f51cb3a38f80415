"""Steps drawn at random, about half of them invalid; and what a world makes of them, as a digest.

`python tests/support/random_steps.py STEPS SCENE...` prints a line per scene: its name and
SHA-256 over every event's bytes.
"""

import hashlib
import random
import sys

import msgspec

from karma.errors import KarmaError
from karma.world.actions.table import ACTIONS
from karma.world.sim import MISUSE, EmbeddedWorld

NAMES = sorted(ACTIONS)
OFTEN = [
    "MoveAhead", "MoveAhead", "RotateLeft", "RotateRight", "LookDown", "LookUp", "MoveLeft",
    "OpenObject", "CloseObject", "PickupObject", "PutObject", "ToggleObjectOn", "DropHeldObject",
    "SliceObject",
]  # fmt: skip
JUNK = [
    None, True, -1, 0, 3, 1e9, float("nan"), float("inf"), -0.0, 0.5, "", "Apple", "Fridge|", [],
    [1, 2], {}, {"x": 1}, {"x": 0.0, "y": 0.9, "z": float("nan")}, [{"x": 0, "y": 0, "z": 0}],
    "x" * 300, [[]], {"y": "north"},
]  # fmt: skip


SUITS = {
    "PickupObject": "pickupable", "PutObject": "receptacle", "OpenObject": "openable",
    "CloseObject": "openable", "ToggleObjectOn": "toggleable", "SliceObject": "sliceable",
}  # fmt: skip


def random_step(draw, objects):
    """Return one action with arguments; `draw` is a random.Random, `objects` the world's."""
    ids = list(objects)
    if draw.random() < 0.05:
        return {"action": draw.choice(["Fly", "", "moveahead", "CreateHouse", "MoveArm"])}
    name = draw.choice(OFTEN if draw.random() < 0.75 else NAMES)
    given = {"action": name}
    if name in SUITS and draw.random() < 0.8:
        fit = [key for key, thing in objects.items() if SUITS[name] in thing.capabilities]
        return {**given, "objectId": draw.choice(fit or ids), "forceAction": True}
    kinds = ACTIONS[name].kinds
    for argument in kinds:
        needed = argument in ACTIONS[name].required
        if argument in ("objectId", "receptacleObjectId") and draw.random() < 0.95:
            given[argument] = draw.choice(ids)
        elif needed or draw.random() < 0.15:
            given[argument] = fitting(draw, kinds[argument], ids)
    if "forceAction" in kinds and draw.random() < 0.6:
        given["forceAction"] = True
    if draw.random() < 0.1:
        given[draw.choice([*kinds, "nonsense", "position", "objectId"])] = draw.choice(JUNK)
    return given


def fitting(draw, kinds, ids):
    """Return a value of one of the types, not always a sensible one."""
    place = {axis: round(draw.uniform(-3, 3), 2) for axis in "xyz"}
    choices = {
        bool: draw.random() < 0.5,
        float: draw.choice([0.0, 0.25, 1.0, 30.0, 90.0, -5.0, draw.uniform(-4, 4)]),
        int: draw.choice([0, 1, 2, 7, -1, 500]),
        str: draw.choice([*ids, "water", "coffee", "Apple", "Cup"]),
        dict: draw.choice([place, {**place, "y": 90.0}, {}, {"x": 1.0}]),
        list: draw.choice([[], [place], [draw.choice(ids)], [0.0, 90.0], [{"objectName": "x"}]]),
    }
    return draw.choice([choices[kind] for kind in kinds if kind in choices] or [None])


def step(world, action):
    """Do one step; misuse counts as its event, and nothing else raises."""
    try:
        world.step(**action)
    except ValueError:
        assert world.last_event.code in MISUSE, action
    return world.last_event


def digest(name, steps):
    """Return (SHA-256 over all events, how many actions failed)."""
    world = EmbeddedWorld(name)
    draw, hashed, failed = random.Random(name), hashlib.sha256(), 0
    for _ in range(steps):
        event = step(world, random_step(draw, world.state.objects))
        hashed.update(msgspec.json.encode(event.metadata))
        failed += not event
        if not 5 <= len(world.state.objects) <= 400:  # taken apart, or copied over and over
            world.reset(name)
    return hashed.hexdigest(), failed


if __name__ == "__main__":
    for scene in sys.argv[2:]:
        try:
            print(scene, *digest(scene, int(sys.argv[1])), flush=True)
        except KarmaError as error:
            sys.exit(f"{scene}: {error}")
