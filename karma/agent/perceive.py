"""From an AI2-THOR event to what the agent may know of it, and to a line of memory.

Every function is a pure function of one event's metadata. `observe` returns only what is in
view. `washed`, `heated` and `cooled` say what the last action did to the things around it; they
speak of the whole scene, so an agent must keep to the ids that it has seen or handled.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from karma.contracts import Event, MemoryUnit, Observation, Pose, SeenObject, Vec3
from karma.household.ids import is_part
from karma.household.pieces import is_piece
from karma.household.places import FLOOR, HAND
from karma.household.uses import BASINS, FRIDGE, MICROWAVE, SINK, TAPS

_Object = Mapping[str, Any]
_FLAGS = (
    ("isCooked", "cooked"), ("isDirty", "dirty"), ("isFilledWithLiquid", "filled"),
    ("isSliced", "sliced"), ("isUsedUp", "used up"),
)  # fmt: skip


def observe(event: Event, *, frame: bool = True) -> Observation:
    """Return what is in view after one action.

    Args:
        event: of AI2-THOR or of the embedded world.
        frame: whether to take the picture along (a world may render it only when asked).
    """
    metadata = event.metadata
    agent = metadata["agent"]
    inventory = {item["objectId"] for item in metadata["inventoryObjects"]}
    held = None
    visible = []
    for thing in metadata["objects"]:
        if thing["objectId"] in inventory:
            held = _seen(thing, (HAND,))
        elif thing["visible"]:
            visible.append(sight_of(thing))
    return Observation(
        pose=Pose(
            position_m=_vector(agent["position"]),
            yaw_deg=float(agent["rotation"]["y"]) % 360.0,
            horizon_deg=float(agent["cameraHorizon"]),
            standing=agent["isStanding"] is not False,  # None for bodies that cannot crouch
        ),
        seen=tuple(visible),
        held=held,
        ok=bool(metadata["lastActionSuccess"]),
        error=str(metadata["errorMessage"] or ""),
        frame=event.frame if frame else None,
    )


def sight_of(thing: _Object) -> SeenObject:
    """Return one object's metadata as a sight of it."""
    return _seen(thing, tuple(thing["parentReceptacles"] or ()))


def states_of(thing: _Object) -> tuple[str, ...]:
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


def shown_states(thing: _Object) -> tuple[str, ...]:
    """Return the words that a picture of an object can tell, sorted; ("none",) for none.

    Those of `states_of`, and "cleaned" for what can be dirty and is not.
    """
    words = set(states_of(thing))
    if thing["dirtyable"] and not thing["isDirty"]:
        words.add("cleaned")
    return tuple(sorted(words or {"none"}))


def washed(event: Event) -> frozenset[str]:
    """Return the ids that lie under a running tap after a successful ToggleObjectOn.

    A tap washes everything in the basin nearest to it, and what that holds in turn.

    Source: ALFRED (Shridhar et al. 2020), the rule by which a demonstration's object is clean.
    """
    if not _done(event, "ToggleObjectOn"):
        return frozenset()
    things = event.metadata["objects"]
    basins = [thing for thing in things if thing["objectType"] in BASINS]
    bare = [t for t in things if t["objectType"] == SINK and not _has_part(t, basins)]
    found: set[str] = set()
    for tap in things:
        if tap["objectType"] in TAPS and tap["isToggled"] and (basins or bare):
            near = min([*basins, *bare], key=lambda basin: (_distance(tap, basin), _id(basin)))
            whole = [thing for thing in things if _has_part(thing, [near])]
            found.update(_contents([near, *whole], things))
    return frozenset(found) - {_id(basin) for basin in basins}


def heated(event: Event) -> frozenset[str]:
    """Return the ids that are hot: by temperature, or in a microwave just switched on."""
    things = event.metadata["objects"]
    hot = {_id(thing) for thing in things if thing["temperature"] == "Hot"}
    if _done(event, "ToggleObjectOn"):
        ovens = [t for t in things if t["objectType"] == MICROWAVE and t["isToggled"]]
        hot.update(_contents(ovens, things))
    return frozenset(hot)


def cooled(event: Event) -> frozenset[str]:
    """Return the ids in closed fridges after a successful CloseObject."""
    if not _done(event, "CloseObject"):
        return frozenset()
    things = event.metadata["objects"]
    fridges = [t for t in things if t["objectType"] == FRIDGE and not t["isOpen"]]
    return frozenset(_contents(fridges, things))


def place_of(seen: SeenObject) -> str | None:
    """Return the receptacle an object lies in, `HAND` when held; the floor only if alone."""
    parents = [parent for parent in seen.parent_ids if not is_part(parent, FLOOR)]
    return next(iter(parents or seen.parent_ids), None)


def to_unit(
    seen: SeenObject, states: Sequence[str], *, handled: bool, image: str | None
) -> MemoryUnit:
    """Return the line of short-term memory for one sight of an object.

    Args:
        seen: the sight.
        states: words that hold, in the order they came about; "none" is dropped.
        handled: the agent manipulated it.
        image: path of the picture below the run folder.
    """
    return MemoryUnit(
        object_id=seen.object_id,
        object_type=seen.object_type,
        position_m=seen.position_m,
        states=tuple(dict.fromkeys(word for word in states if word != "none")),
        place_id=place_of(seen),
        handled=handled,
        image=image,
    )


# ----------------------------------------------------------------- parts of metadata


def _id(thing: _Object) -> str:
    return str(thing["objectId"])


def _vector(point: Mapping[str, float]) -> Vec3:
    return float(point["x"]), float(point["y"]), float(point["z"])


def _seen(thing: _Object, parents: tuple[str, ...]) -> SeenObject:
    box = thing["axisAlignedBoundingBox"]
    return SeenObject(
        object_id=_id(thing),
        object_type=str(thing["objectType"]),
        position_m=_vector(thing["position"]),
        box_center_m=_vector(box["center"]),
        box_size_m=_vector(box["size"]),
        pickupable=bool(thing["pickupable"]),
        parent_ids=parents,
        states=states_of(thing),
    )


def _done(event: Event, action: str) -> bool:
    metadata = event.metadata
    return bool(metadata["lastAction"] == action and metadata["lastActionSuccess"])


def _distance(one: _Object, other: _Object) -> float:
    a, b = (_vector(thing["axisAlignedBoundingBox"]["center"]) for thing in (one, other))
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True))


def _has_part(whole: _Object, parts: Iterable[_Object]) -> bool:
    """Return whether one of `parts` is a part of `whole` (`Sink|x|y|z|SinkBasin`)."""
    return any(is_part(_id(part), _id(whole)) for part in parts)


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
