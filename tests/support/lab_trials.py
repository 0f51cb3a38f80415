"""Trials in ALFRED's form for the laboratory's tests."""

import gzip
import json


def trial(plan, thing, parent, *, movable="", toggle="", sliced=False, picked=()):
    """A record in ALFRED's form, with the pick-ups as (object, receptacle)."""
    steps = [
        {
            "planner_action": {
                "action": "PickupObject",
                "objectId": f"{kind}|+01.00|+01.00|+01.00",
                "coordinateReceptacleObjectId": [place, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]],
            }
        }
        for kind, place in picked
    ]
    return {
        "pddl_params": {"object_target": thing, "parent_target": parent, "toggle_target": toggle,
                        "mrecep_target": movable, "object_sliced": sliced},
        "scene": {"floor_plan": f"FloorPlan{plan}"},
        "plan": {"high_pddl": steps},
    }  # fmt: skip


def write_trials(path, trials):
    lines = b"".join(json.dumps(one).encode() + b"\n" for one in trials)
    path.write_bytes(gzip.compress(lines, mtime=0))
    return path
