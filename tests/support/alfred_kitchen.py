"""A demonstration of our own in ALFRED's form, over the kitchen of tests/support/household.py.

Someone takes an apple from the table and shuts it in the fridge.
"""

import copy
import gzip
import json

from karma.plugins.alfred.replay.facts import Files
from karma.plugins.alfred.replay.trial import read_trials
from karma.world.sim import EmbeddedWorld
from support.household import kitchen

PLAN = "FloorPlan7"
APPLE, KNIFE = "Apple|+01.40|+00.81|-00.50", "Knife|+01.35|+00.81|-00.65"
FRIDGE, TABLE = "Fridge|-01.65|+00.90|-00.20", "DiningTable|+01.65|+00.40|-00.40"


def pose(name, position, **more):
    xyz = dict(zip("xyz", position, strict=True))
    return {"objectName": name, "position": xyz, "rotation": {"x": 0, "y": 0, "z": 0}, **more}


def spot(kind, position):
    x, y, z = (4 * value for value in position)
    return [kind, [x, x, z, z, y, y]]


def goto(number, location):
    return {"high_idx": number, "planner_action": {"action": "GotoLocation", "location": location}}


def low(number, *actions):
    """Low-level actions of one sub-goal, each a name or a (name, arguments)."""
    rows = []
    for action in actions:
        name, more = (action, {}) if isinstance(action, str) else action
        if name == "MoveAhead":
            more = {"moveMagnitude": 0.25, "forceAction": True}
        rows.append({"high_idx": number, "api_action": {"action": name, **more}})
    return rows


def put(thing, receptacle):
    return (
        "PutObject",
        {
            "objectId": thing,
            "receptacleObjectId": receptacle,
            "forceAction": True,
            "placeStationary": True,
            "unknownKey": [1],
        },
    )


def on(name, thing, **more):
    return (name, {"objectId": thing, **more})


TO_TABLE = ("RotateRight", *["MoveAhead"] * 3, "RotateRight", *["MoveAhead"] * 2, "RotateLeft")
TO_FRIDGE = ("LookUp", "RotateLeft", "RotateLeft", *["MoveAhead"] * 5)


def trial():
    """The demonstration as JSON: every action needed, every pose as the planner says."""
    return {
        "id": "ours_1",
        "task_type": "pick_and_place_simple",
        "pddl_params": {
            "object_target": "Apple", "parent_target": "Fridge", "toggle_target": "",
            "mrecep_target": "", "object_sliced": False,
        },
        "scene": {
            "floor_plan": PLAN,
            "init_action": {
                "action": "TeleportFull", "x": 0.0, "y": 0.9, "z": 0.0, "rotation": 0,
                "horizon": 30,
            },
            "object_poses": [
                pose("Apple_1", (1.4, 0.81, -0.5)),
                pose("Knife_1", (1.35, 0.81, -0.65), objectId=KNIFE),
                pose("Egg_1", (-1.55, 0.7, -0.2)),
            ],
            "object_toggles": [],
            "dirty_and_empty": False,
        },
        "plan": {
            "high_pddl": [
                goto(0, "loc|3|-2|1|45"),
                {
                    "high_idx": 1,
                    "planner_action": {
                        "action": "PickupObject", "objectId": APPLE,
                        "coordinateObjectId": spot("Apple", (1.4, 0.81, -0.5)),
                        "coordinateReceptacleObjectId": spot("DiningTable", (1.65, 0.4, -0.4)),
                    },
                },
                goto(2, "loc|-2|-2|3|30"),
                {
                    "high_idx": 3,
                    "planner_action": {
                        "action": "PutObject", "objectId": APPLE, "receptacleObjectId": FRIDGE,
                        "coordinateReceptacleObjectId": spot("Fridge", (-1.65, 0.9, -0.2)),
                    },
                },
                {"high_idx": 4, "planner_action": {"action": "End", "value": 1}},
            ],
            "low_actions": [
                *low(0, *TO_TABLE, "LookDown"),
                *low(1, on("PickupObject", APPLE)),
                *low(2, *TO_FRIDGE),
                *low(3, on("OpenObject", FRIDGE), put(APPLE, FRIDGE), on("CloseObject", FRIDGE)),
            ],
        },
    }  # fmt: skip


def dump():
    """The kitchen as AI2-THOR's dump would have it."""
    objects = copy.deepcopy(EmbeddedWorld(kitchen()).last_event.metadata["objects"])
    return {"scene": PLAN, "objects": objects}


def layout():
    """The kitchen's cells as ALFRED's layouts have them."""
    return {PLAN: {"reachable": [list(cell) for cell in kitchen().reachable]}}


def write(path, *rows):
    """Write rows as JSON lines; gzipped where the name says so."""
    data = "".join(json.dumps(row) + "\n" for row in rows).encode()
    path.write_bytes(gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)
    return path


def read(folder, given):
    """The record of one trial, by way of a file."""
    (found,) = read_trials(write(folder / "trial.jsonl", given))
    return found


def beside(folder):
    """All that is known of the kitchen beside the trial."""
    return Files(
        dumps=write(folder / "dump.jsonl.gz", dump()),
        layouts=write(folder / "layouts.json", layout()),
    )


def reference(folder):
    """Write the reference data of our kitchen below a folder, which is returned."""
    for name, data in (("thor5/scenes.jsonl.gz", dump()), ("alfred/layouts.json.gz", layout())):
        path = folder / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, data)
    return folder
