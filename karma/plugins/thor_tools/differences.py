"""Compare two events value by value, and tell where each difference comes from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from karma.household.ids import type_of, whole_id
from karma.household.pieces import is_piece
from karma.plugins.thor_tools.importing.scenes import FLAGS as CAPABILITIES

STATES = (
    "isToggled", "isBroken", "isFilledWithLiquid", "fillLiquid", "isDirty", "isUsedUp", "isCooked",
    "temperature", "isSliced", "isOpen", "openness", "isPickedUp",
)  # fmt: skip
LISTS = ("receptacleObjectIds", "parentReceptacles")
FLAGS = (*STATES, *LISTS, *CAPABILITIES)
SEEN = ("visible", "isInteractable")
MOTION = ("isMoving",)

CAUSES = {
    "jitter": "the real simulator changed it without an action: physics lets things settle, "
    "slide or fall",
    "start": "differs from the first event on: our scenes refuse two things in each other, and "
    "openness where isOpen is false",
    "place": "it came to lie elsewhere: where a put or a fall ends is chosen by physics",
    "pieces": "another number of slices: it belongs to the asset and is not published",
    "one side only": "an object that only one side has",
    "outcome": "the action ended otherwise here, and what follows from that",
    "heat": "heat and cold: the real simulator counts seconds of its own clock",
    "water": "a stream of water or coffee: the real simulator asks whether it is met",
    "breaking": "whether a fall or a throw breaks depends on the meshes that meet",
    "agent": "the agent's pose",
    "unexplained": "no rule tells",
}
MISSING = "absent"  # the value of an object that one side does not have

_BY_FIELD = {
    "parentReceptacles": "place",
    "temperature": "heat",
    "isFilledWithLiquid": "water",
    "fillLiquid": "water",
    "isDirty": "water",
    "isBroken": "breaking",
}
KINDS = {**dict.fromkeys(SEEN, "seen"), **dict.fromkeys(MOTION, "motion")}
_NEAR_POSE, _NEAR = 0.02, 1e-3

Row = Mapping[str, Any]
Key = tuple[str, str]  # object id and field
Values = dict[Key, Any]  # lists of ids as frozen sets


@dataclass(frozen=True, slots=True, kw_only=True)
class MomentPair:
    """Both sides after one action."""

    action: Row
    ours: Row
    theirs: Row


def values(metadata: Row) -> Values:
    """Return every value that is compared."""
    agent = metadata["agent"]
    found: Values = {
        ("", "lastActionSuccess"): metadata["lastActionSuccess"],
        ("", "inventoryObjects"): frozenset(o["objectId"] for o in metadata["inventoryObjects"]),
        ("", "agent.isStanding"): agent.get("isStanding"),
    }
    for field in ("position", "rotation"):
        found["", f"agent.{field}"] = tuple(float(agent[field][axis]) for axis in "xyz")
    found["", "agent.cameraHorizon"] = (float(agent["cameraHorizon"]),)
    for thing in metadata["objects"]:
        for field in (*FLAGS, *KINDS):
            value = thing.get(field)
            found[thing["objectId"], field] = (
                frozenset(value) if isinstance(value, list | tuple) else value
            )
    return found


def alike(ours: Any, theirs: Any) -> bool:
    """Return whether two values count as equal: poses nearly, all else exactly."""
    if isinstance(ours, tuple) and isinstance(theirs, tuple):
        return all(_near(a, b) for a, b in zip(ours, theirs, strict=True))
    if isinstance(ours, float) and isinstance(theirs, float | int):
        return abs(ours - theirs) <= _NEAR
    return bool(ours == theirs)


def _near(a: float, b: float) -> bool:
    """Return whether two metres or degrees of a pose are one."""
    return abs((a - b + 180) % 360 - 180) <= _NEAR_POSE


def shown(value: Any) -> Any:
    """Return a value as a report gives it."""
    return sorted(value) if isinstance(value, frozenset) else value


class Attribution:
    """Tells by rule where a difference comes from; a difference counts whatever its cause."""

    def __init__(self, start: MomentPair) -> None:
        self._ours, self._theirs = values(start.ours), values(start.theirs)
        self._touched: set[str] = set()  # ids that an action concerned so far
        self._outcomes: set[str] = set()  # of them, those of an action that ended otherwise here
        self._alone: set[Key] = set()  # what the real simulator changed without an action

    def follow(self, moment: MomentPair, before: Values, theirs: Values) -> None:
        """Take note of one action, and of what the real simulator changed beside it."""
        near = {str(moment.action.get("objectId", ""))}
        near |= before["", "inventoryObjects"] | theirs["", "inventoryObjects"]
        near |= {o["objectId"] for o in moment.ours["inventoryObjects"]}
        for object_id in tuple(near):
            near |= before.get((object_id, "receptacleObjectIds")) or frozenset()
        self._touched |= near - {""}
        if moment.ours["lastActionSuccess"] != moment.theirs["lastActionSuccess"]:
            self._outcomes |= near - {""}
        self._alone |= {
            key
            for key, value in theirs.items()
            if key[0] and not self._concerned(key[0]) and not alike(before.get(key), value)
        }

    def _concerned(self, object_id: str) -> bool:
        whole = whole_id(object_id)  # of a slice
        return object_id in self._touched or whole in self._touched

    def cause(self, object_id: str, field: str, ours: Any, theirs: Any) -> str:
        """Return one of `CAUSES`."""
        key = (object_id, field)
        if ours is MISSING or theirs is MISSING or ours == MISSING or theirs == MISSING:
            return "pieces" if is_piece(type_of(object_id)) else "one side only"
        if self._ours.get(key) == ours and self._theirs.get(key) == theirs:
            return "start"
        if field == "receptacleObjectIds":
            return self._of_contents(ours or frozenset(), theirs or frozenset())
        if key in self._alone:
            return "jitter"
        if not object_id:
            return "outcome" if field in ("lastActionSuccess", "inventoryObjects") else "agent"
        if object_id in self._outcomes:
            return "outcome"
        return _BY_FIELD.get(field, "unexplained")

    def _of_contents(self, ours: frozenset[str], theirs: frozenset[str]) -> str:
        """Return why two lists of contents differ: as their members' parents do."""
        strangers = ours ^ theirs
        if any(is_piece(type_of(member)) for member in strangers):
            return "pieces"
        if all((member, "parentReceptacles") in self._alone for member in strangers):
            return "jitter"
        return "outcome" if strangers & self._outcomes else "place"
