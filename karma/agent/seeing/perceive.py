"""The one reader of AI2-THOR events: what the agent may know of them, and the whole truth.

Every function is a pure function of one event. The agent's share is `observe` (what is in view or
was touched), its pose and camera, the map of the floor and the words of a refusal. `truth_of` is
for the judge of goals, the expert and the benchmark. After this module there are only nouns.
"""

import re
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from typing import Any

from karma.household.ids import is_part
from karma.household.pieces import is_piece
from karma.household.places import FLOOR, HAND
from karma.household.uses import FRIDGE, MICROWAVE
from karma.household.water import Lying, wetted
from karma.types.observation import (
    Observation,
    Reason,
    ReasonKind,
    SeenObject,
    TrueObject,
    Truth,
)
from karma.types.roles import Event
from karma.types.space import CameraPose, Pose, Vec3

_Object = Mapping[str, Any]
_FLAGS = (
    ("isCooked", "cooked"), ("isDirty", "dirty"), ("isFilledWithLiquid", "filled"),
    ("isSliced", "sliced"), ("isUsedUp", "used up"),
)  # fmt: skip
_UNKNOWN = "the world refused"  # where it says nothing
_ROOM_MATTERS = re.compile(
    r"block|collid|collision|in the way|no valid position|not found within|visib|interact|reach",
    re.IGNORECASE,
)
_UNREACHED = ("not found within", "not interactable", "visib", "block", "collid", "in the way")
_KINDS: tuple[tuple[ReasonKind, tuple[str, ...]], ...] = (
    ("held", ("if it is in the agent's hand",)),
    ("open", ("must be closed",)),
    ("on", ("must be off",)),
    ("closed", ("is closed",)),
    ("pickupable", ("property pickupable",)),
    ("sliceable", ("property sliceable",)),
    ("breakable", ("property breakable",)),
    ("canFillWithLiquid", ("property canfill",)),
    ("openable", ("not an openable",)),
    ("toggleable", ("not a toggleable",)),
    ("empty", ("already empty",)),
    ("broken", ("is broken", "already broken")),
    ("misplaced", ("cannot be placed", "not a receptacle")),
    ("full", ("no valid position",)),
    ("unreached", _UNREACHED),
)  # the first whose signs stand in the words


# ----------------------------------------------------------------- what the agent may know


def observe(
    event: Event, *, touched: Collection[str] = (), known: Container[str] = ()
) -> Observation:
    """Return what the agent learns from one action.

    The action was done to `touched`, of which the agent knows out of view too; of `known` ids it
    learns what a tap or an oven did.
    """
    things = event.metadata["objects"]
    inventory = _inventory(event)
    held, seen, at_hand, reachable = None, [], [], set()
    for thing in things:
        object_id = thing["objectId"]
        if object_id in inventory:
            held = sight_of(thing, (HAND,))
        elif thing["visible"]:
            seen.append(sight_of(thing))
            if thing["isInteractable"]:
                reachable.add(object_id)
        elif object_id in touched:
            at_hand.append(sight_of(thing))
    washed = heated = cooled = frozenset[str]()
    on = done(event, "ToggleObjectOn")
    if touched and (on or done(event, "CloseObject")):
        near = {*touched, *inventory, *(sight.object_id for sight in seen)}
        washed, heated, cooled = (
            frozenset(name for name in changed if name in near or name in known)
            for changed in (_washed(event), _heated(event) if on else (), _cooled(event))
        )
    return Observation(
        pose=pose_of(event),
        camera=camera_of(event),
        seen=tuple(seen),
        held=held,
        reachable=frozenset(reachable),
        reason=refusal(event),
        touched=tuple(at_hand),
        pieces=_pieces(event, touched) if done(event, "SliceObject") else (),
        washed=washed,
        heated=heated,
        cooled=cooled,
        render=lambda: event.frame,
    )


def states_in(event: Event) -> Mapping[str, tuple[str, ...]]:
    """Return id -> the true state words, for a reader that is to have no error."""
    return {_id(thing): _states(thing) for thing in event.metadata["objects"]}


def grips(event: Event) -> bool:
    """Return whether the hand feels something in it."""
    return bool(_inventory(event))


def done(event: Event, action: str) -> bool:
    """Return whether the last action was this one, and happened."""
    metadata = event.metadata
    return bool(metadata["lastAction"] == action and metadata["lastActionSuccess"])


def pose_of(event: Event) -> Pose:
    """Return where the agent stands and looks."""
    agent = event.metadata["agent"]
    return Pose(
        position_m=_vector(agent["position"]),
        yaw_deg=float(agent["rotation"]["y"]) % 360.0,
        horizon_deg=float(agent["cameraHorizon"]),
        standing=agent["isStanding"] is not False,  # None for bodies that cannot crouch
    )


def camera_of(event: Event) -> CameraPose:
    """Return where the camera is and how it maps the world to the event's frame."""
    metadata = event.metadata
    return CameraPose(
        position_m=_vector(metadata["cameraPosition"]),
        yaw_deg=float(metadata["agent"]["rotation"]["y"]),
        horizon_deg=float(metadata["agent"]["cameraHorizon"]),
        fov_deg=float(metadata["fov"]),
        width_px=int(metadata["screenWidth"]),
        height_px=int(metadata["screenHeight"]),
    )


def scene_of(event: Event) -> str:
    """Return the world's own name of the scene."""
    return str(event.metadata["sceneName"])


def object_count(event: Event) -> int:
    """Return how many objects the scene has, whatever is said of each."""
    return len(event.metadata["objects"])


def fixed_of(event: Event) -> Iterator[tuple[str, Vec3]]:
    """Yield id and position of what nobody carries away, in view or not: it tells rooms apart."""
    for one in event.metadata["objects"]:
        if not one["pickupable"]:
            place = one["position"]
            yield one["objectId"], (place["x"], place["y"], place["z"])


def digest_of(event: Event) -> str:
    """Return a SHA-256 of how all things lie and are: it tells whether a home is as it was left."""
    things = [
        [thing["objectId"], thing["parentReceptacles"], thing["isPickedUp"], thing["isOpen"],
         thing["isToggled"], thing["isBroken"], thing["isSliced"], thing["isDirty"],
         thing["isFilledWithLiquid"],
         [round(thing["position"][axis], 3) for axis in "xyz"]]
        for thing in event.metadata["objects"]
    ]  # fmt: skip
    return sha256(repr(things).encode()).hexdigest()


def cells_of(event: Event) -> list[Vec3]:
    """Return the cells that can be stood on, after GetReachablePositions; [] if it was refused."""
    return [_vector(cell) for cell in event.metadata["actionReturn"] or ()]


def refusal(event: Event) -> Reason | None:
    """Return why the last action did not happen, None if it did."""
    return None if event else reason_of(str(event.metadata["errorMessage"] or ""))


def sight_of(thing: _Object, parents: tuple[str, ...] | None = None) -> SeenObject:
    """Return one object's metadata as a sight of it, in or on other things than it says."""
    fields = _sight_fields(thing)
    return SeenObject(**(fields if parents is None else {**fields, "parent_ids": parents}))


def place_of(seen: SeenObject) -> str | None:
    """Return the receptacle an object lies in, `HAND` when held; the floor only if alone."""
    parents = [parent for parent in seen.parent_ids if not is_part(parent, FLOOR)]
    return next(iter(parents or seen.parent_ids), None)


def lying(seen: SeenObject) -> Lying:
    """Return a thing as water meets it."""
    box, closed = (seen.box_center_m, seen.box_size_m), "closed" in seen.states
    return Lying(seen.object_id, seen.object_type, *box, seen.parent_ids, closed)


# ----------------------------------------------------------------- the whole truth


def truth_of(event: Event) -> Truth:
    """Return everything in the scene, and what the last action did to it."""
    return Truth(
        objects=tuple(_true(thing) for thing in event.metadata["objects"]),
        held_ids=_inventory(event),
        washed=_washed(event),
        heated=_heated(event),
        cooled=_cooled(event),
    )


# ----------------------------------------------------------------- parts of metadata


def _id(thing: _Object) -> str:
    return str(thing["objectId"])


def _vector(point: Mapping[str, float]) -> Vec3:
    return float(point["x"]), float(point["y"]), float(point["z"])


def _sight_fields(thing: _Object) -> dict[str, Any]:
    box = thing["axisAlignedBoundingBox"]
    return {
        "object_id": _id(thing),
        "object_type": str(thing["objectType"]),
        "position_m": _vector(thing["position"]),
        "box_center_m": _vector(box["center"]),
        "box_size_m": _vector(box["size"]),
        "pickupable": bool(thing["pickupable"]),
        "parent_ids": tuple(thing["parentReceptacles"] or ()),
        "states": _states(thing),
        "controls": tuple(thing["controlledObjects"] or ()),
    }


def _true(thing: _Object) -> TrueObject:
    return TrueObject(
        **_sight_fields(thing),
        distance_m=float(thing["distance"]),
        visible=bool(thing["visible"]),
        child_ids=tuple(thing["receptacleObjectIds"] or ()),
        receptacle=bool(thing["receptacle"]),
        openable=bool(thing["openable"]),
        dirtyable=bool(thing["dirtyable"]),
        broken=bool(thing["isBroken"]),
        temperature=str(thing["temperature"]),
    )


def _states(thing: _Object) -> tuple[str, ...]:
    """Return the state words of one object's metadata, sorted; () when none applies."""
    words = {word for flag, word in _FLAGS if thing[flag]}
    if is_piece(thing["objectType"]):
        words.add("sliced")
    if thing["temperature"] == "Hot":
        words.add("heated")
    if thing["toggleable"] or thing["isToggled"]:  # a burner is on, but its knob is toggleable
        words.add("on" if thing["isToggled"] else "off")
    if thing["openable"]:
        words.add("opened" if thing["isOpen"] else "closed")
    return tuple(sorted(words))


def _inventory(event: Event) -> frozenset[str]:
    return frozenset(item["objectId"] for item in event.metadata["inventoryObjects"])


def _pieces(event: Event, wholes: Iterable[str]) -> tuple[SeenObject, ...]:
    """Return what has been cut off the wholes, wherever it lies."""
    things = event.metadata["objects"]
    return tuple(sight_of(t) for t in things if any(is_part(_id(t), whole) for whole in wholes))


def _washed(event: Event) -> frozenset[str]:
    """Return what running taps reach after a successful ToggleObjectOn.

    Source: ALFRED (Shridhar et al. 2020), the rule by which a demonstration's object is clean.
    """
    if not done(event, "ToggleObjectOn"):
        return frozenset()
    things = event.metadata["objects"]
    running = [_id(thing) for thing in things if thing["isToggled"]]
    return wetted(running, (lying(sight_of(thing)) for thing in things))


def _heated(event: Event) -> frozenset[str]:
    """Return the ids that are hot: by temperature, or in a microwave just switched on."""
    things = event.metadata["objects"]
    hot = {_id(thing) for thing in things if thing["temperature"] == "Hot"}
    if done(event, "ToggleObjectOn"):
        ovens = [t for t in things if t["objectType"] == MICROWAVE and t["isToggled"]]
        hot.update(_contents(ovens, things))
    return frozenset(hot)


def _cooled(event: Event) -> frozenset[str]:
    """Return the ids in closed fridges after a successful CloseObject."""
    if not done(event, "CloseObject"):
        return frozenset()
    things = event.metadata["objects"]
    fridges = [t for t in things if t["objectType"] == FRIDGE and not t["isOpen"]]
    return frozenset(_contents(fridges, things))


def _contents(receptacles: Iterable[_Object], things: Sequence[_Object]) -> Iterator[str]:
    """Yield what lies in the receptacles, and in that again."""
    inside = {_id(thing): thing["receptacleObjectIds"] or () for thing in things}
    waiting = [child for thing in receptacles for child in inside[_id(thing)]]
    known: set[str] = set()
    while waiting:
        child = waiting.pop()
        if child not in known:
            known.add(child)
            yield child
            waiting.extend(inside.get(child, ()))


# ----------------------------------------------------------------- why the world refused


def reason_of(words: str) -> Reason:
    """Return what a refusal means."""
    text = words.split(". trace:")[0].strip()
    text = re.sub(r"^\w+Exception: ", "", text)
    text = re.sub(r"\b([A-Z][A-Za-z]+)_[0-9a-f]{8}\b", r"\1", text) or _UNKNOWN
    said = text.lower()
    kinds = (kind for kind, signs in _KINDS if any(sign in said for sign in signs))
    elsewhere = bool(_ROOM_MATTERS.search(text))
    return Reason(words=text, kind=next(kinds, "other"), elsewhere=elsewhere)
