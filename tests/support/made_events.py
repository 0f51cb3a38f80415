"""Events made by hand, and what goals say of them."""

from types import SimpleNamespace

from karma.goals.goals import GoalTracker, parse_goal

ORIGIN = {"x": 0.0, "y": 0.0, "z": 0.0}


def thing(object_id, *, inside=(), **fields):
    """One object's metadata with everything off, out of the hand and at the origin."""
    object_type = fields.pop("objectType", object_id.split("|")[0])
    flags = (
        "receptacle", "pickupable", "openable", "isOpen", "toggleable", "isToggled", "dirtyable",
        "isDirty", "isFilledWithLiquid", "isBroken", "isUsedUp", "isCooked", "isSliced", "visible",
    )  # fmt: skip
    return {
        **dict.fromkeys(flags, False),
        "objectId": object_id,
        "objectType": object_type,
        "parentReceptacles": list(inside) or None,
        "receptacleObjectIds": [],
        "controlledObjects": None,
        "distance": 0.0,
        "temperature": "RoomTemp",
        "position": ORIGIN,
        "axisAlignedBoundingBox": {"center": ORIGIN, "size": ORIGIN},
        **fields,
    }


def event(*things, held=(), action="Pass", ok=True):
    things = [dict(one) for one in things]
    for holder in things:
        holder["receptacleObjectIds"] = [
            one["objectId"]
            for one in things
            if holder["objectId"] in (one["parentReceptacles"] or ())
        ]
    return SimpleNamespace(
        frame=None,
        metadata={
            "objects": things,
            "inventoryObjects": [
                {"objectId": key, "objectType": key.split("|")[0]} for key in held
            ],
            "lastAction": action,
            "lastActionSuccess": ok,
        },
    )


def goals(*texts):
    return tuple(parse_goal(text) for text in texts)


def unmet(last, *texts, before=()):
    """Return the texts of the goals that fail after the events, in one sub-task."""
    tracker = GoalTracker()
    first, *rest = [*before, last]
    tracker.start(first)
    for later in rest:
        tracker.update(later)
    return [str(goal) for goal in tracker.unmet(goals(*texts), last)]
