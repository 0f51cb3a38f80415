"""Carry out the benchmark's actions in our world; each ends in "" or in what went wrong.

What differs with `strict` is listed in docs/plugins/alfred.md.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from karma.household.ids import is_id, is_part, root_type, type_of
from karma.household.uses import BASIN_OF, BASINS, FAUCET, FRIDGE, MICROWAVE, SINK
from karma.plugins.alfred.eb_world.actions import (
    EB_ALFRED,
    NumberedAction,
    RoomProtocol,
    Thing,
    by_id,
    nearest,
)
from karma.plugins.alfred.replay.goal import Deeds, noteworthy
from karma.world.core.view import CAMERA_M
from karma.world.event import WorldEvent
from karma.world.sim import EmbeddedWorld

_OPENINGS = (("MoveBack",), ("MoveBack", "MoveRight"), ("MoveLeft", "MoveLeft"), ())
_AS_TOLD_M = 0.9 + 0.75  # the camera's height in the source, which is too high
_TILT = 0.9  # of the angle to the object
_LOOK_DEG = 15.0
_BEFORE: tuple[tuple[tuple[str, int], ...], ...] = (
    (),
    (("LookUp", 2),),
    (("LookDown", 4),),
    (("LookUp", 2), ("MoveBack", 1)),
    (("MoveAhead", 1), ("MoveRight", 4)),
    (("MoveLeft", 8),),
    (("MoveRight", 4),),  # the source also turns the hand, which changes nothing here
)


@dataclass(slots=True)
class Body:
    """The robot in one episode."""

    world: EmbeddedWorld
    names: Mapping[str, str]  # of the objects of a type that there are several of, by id
    protocol: RoomProtocol = EB_ALFRED
    strict: bool = False  # follow the source where it is odd
    puts: dict[str, int] = field(default_factory=dict)  # how often at which target
    deeds: Deeds = field(default_factory=lambda: Deeds(agreeing=False))
    target: str = ""  # of a put: id or type of what was found last
    cutting: bool = False  # something was to be cut: pieces come first

    def act(self, action: NumberedAction) -> str:
        """Do one action."""
        if action.verb not in ("put", "open"):
            self.target = ""
        does: dict[str, Callable[[], str]] = {
            "find": lambda: self._find(action),
            "pick up": lambda: self._pick_up(action.noun),
            "put": self._put,
            "drop": self._drop,
            "open": lambda: self._open(action),
            "close": lambda: self._close(action),
            "slice": lambda: self._slice(action.noun),
            "turn on": lambda: self._switch(action.noun, on=True),
            "turn off": lambda: self._switch(action.noun, on=False),
        }
        return does[action.verb]()

    # ------------------------------------------------------------- parts

    @property
    def _things(self) -> Sequence[Thing]:
        return self.world.last_event.objects

    @property
    def _held(self) -> str | None:
        return self.world.state.held

    def _do(self, name: str, object_id: str) -> WorldEvent:
        """Do an action on an object, and note what it did for good."""
        event = self.world.step(name, objectId=object_id)
        if event.success and noteworthy(name, object_id):
            after = event.metadata
            if self.strict:  # only a basin in view has its contents cleaned
                seen = [one for one in after["objects"] if one["visible"] or not is_basin(one)]
                after = {**after, "objects": seen}
            self.deeds.note(name, object_id, after)
        return event

    def _find(self, action: NumberedAction) -> str:
        self.target = action.object_id or action.noun
        word = root_type(action.object_id) if action.object_id else action.noun
        thing = self._nearest(word, by_sight=True, pieces_first=self.cutting)
        if action.object_id and not (thing and is_part(thing["objectId"], of=action.object_id)):
            thing = by_id(self._things, action.object_id)
        if thing is None:
            return f"no {action.noun} was found; this room may have none, so try other instances"
        if thing["visible"] and thing["distance"] < self.protocol.stays_within_m:
            return ""
        if not go_to(self.world, thing, strict=self.strict):
            return f"there is no free place at the {action.noun}"
        return ""

    def _pick_up(self, noun: str) -> str:
        thing = self._nearest(noun, able="pickupable", by_sight=True, pieces_first=self.cutting)
        if thing is None:
            return f"there is no {noun} to pick up; find one first"
        if self._do("PickupObject", thing["objectId"]).success:
            return ""
        if not thing["visible"] and thing["parentReceptacles"]:
            place = thing["parentReceptacles"][0]
            shown = self.names.get(place, root_type(place))
            message = f"the {noun} is out of sight, it is in {shown}"
            if not self.protocol.numbered:
                return message
            several = f"there may be more than one {root_type(place)}"
            return f"{message} ({several}); go there to pick it up"
        if self._held is not None:
            return f"the hand already holds {type_of(self._held)}"
        if self.strict:
            return _EMPTY
        return f"the {noun} is out of sight or out of reach; {_EMPTY}"

    def _drop(self) -> str:
        if self._held is None:
            return _EMPTY
        event = self.world.step("DropHeldObject", forceAction=True)
        if not event.success:
            return "letting go failed"
        return "" if self.protocol.drop_counts else _DROPPED

    def _open(self, action: NumberedAction) -> str:
        thing = self._meant(action)
        if thing is None:
            return f"there is no {action.noun} to open; find one first"
        if thing["isOpen"]:
            return f"opening failed: the {action.noun} is already open"
        for steps in _OPENINGS:
            if self._do("OpenObject", thing["objectId"]).success:
                return ""
            for step in steps:
                self.world.step(step)
        return "opening failed"

    def _close(self, action: NumberedAction) -> str:
        thing = self._meant(action)
        if thing is None:
            return f"there is no {action.noun} to close"
        if thing["openable"] and not thing["isOpen"]:
            return f"closing failed: the {action.noun} is already closed"
        event = self._do("CloseObject", thing["objectId"])
        return "" if event.success else "closing failed"

    def _switch(self, noun: str, *, on: bool) -> str:
        word = "on" if on else "off"
        thing = self._nearest(noun, able="toggleable", by_sight=not self.strict)
        if thing is None:
            return f"there is no {noun} to turn {word}"
        event = self._do(f"ToggleObject{word.title()}", thing["objectId"])
        in_view = {one["objectType"] for one in self._things if one["visible"]}
        stumbles = self.strict and on and noun == FAUCET and BASIN_OF[SINK] not in in_view
        # the source stumbles over a basin out of view, but the tap is on
        return "" if event.success and not stumbles else f"turning {word} failed"

    def _slice(self, noun: str) -> str:
        self.cutting = True
        thing = self._nearest(noun, by_sight=not self.strict)
        if thing is None:
            return f"there is no {noun} to slice"
        event = self._do("SliceObject", thing["objectId"])
        return "" if event.success else "slicing failed"

    def _nearest(self, word: str, **more: Any) -> Thing | None:
        return nearest(self._things, word, any_lid=self.strict, **more)

    def _meant(self, action: NumberedAction) -> Thing | None:
        if action.object_id:
            return by_id(self._things, action.object_id)
        return self._nearest(action.noun)

    def _put(self) -> str:
        if not self.target:
            return self._drop()
        self.puts[self.target] = self.puts.get(self.target, 0) + 1
        before = self.world.last_event
        if self._held is None:
            return _EMPTY
        basin_first = self.protocol.basin_first
        if put_at(self.world, self.target, basin_first=basin_first, strict=self.strict):
            return ""
        kind = self.names.get(self.target, root_type(self.target))
        message = f"putting it at the {kind} failed; see whether it is open, or try other instances"
        if not self.strict:
            self.world.back_to(before)
        if self.puts[self.target] >= self.protocol.patience:
            dropped = self._drop()
            if not self.protocol.drop_counts:
                return dropped
            return f"{message}; it was dropped instead"
        return message


_EMPTY = "the hand holds nothing"
_DROPPED = "putting it down failed, and it was dropped"


_TRIES, _FROM_THE_SIDE = 20, 10
_LEAST_DEG, _MOST_DEG = -30.0, 60.0  # that AI2-THOR's looks reach


def go_to(world: EmbeddedWorld, thing: Thing, *, strict: bool) -> bool:
    """Teleport to the cell nearest to an object's origin, turned to it; tell if one was free.

    If strict, tilt as from the source's height, and beyond what looks reach.
    """
    x, y, z = (float(thing["position"][axis]) for axis in "xyz")
    state = world.state
    height = _AS_TOLD_M if strict else state.pose.position_m[1] + CAMERA_M
    for cell_x, cell_z in _cells(world, thing):
        if state.room.key(cell_x, cell_z) not in state.cells:
            continue
        far = math.hypot(x - cell_x, z - cell_z)
        tilt = _TILT * math.degrees(math.atan2(height - y, far))
        if not strict:
            tilt = min(max(tilt, _LEAST_DEG), _MOST_DEG)
        event = world.step(
            "TeleportFull", x=cell_x, y=state.pose.position_m[1], z=cell_z,
            rotation={"x": 0.0, "y": _yaw(x - cell_x, z - cell_z), "z": 0.0}, horizon=tilt,
            standing=True, forceAction=strict,  # else a tilt that looks do not reach is refused
        )  # fmt: skip
        if event.success:
            return True
    return False


def _cells(world: EmbeddedWorld, thing: Thing) -> Iterator[tuple[float, float]]:
    """Yield the cells to try; those of fridges and microwaves from the front first."""
    x, z = float(thing["position"]["x"]), float(thing["position"]["z"])
    ranked = sorted(world.state.room.cells.values(), key=lambda at: (math.dist(at, (x, z)), at))[
        :_TRIES
    ]
    kind = root_type(thing["objectId"])
    if kind not in (FRIDGE, MICROWAVE):
        yield from ranked
        return
    turn = float(thing["rotation"]["y"])
    near = ranked[:_FROM_THE_SIDE]
    for at in near:
        off = abs((_yaw(x - at[0], z - at[1]) - turn + 180.0) % 360.0 - 180.0)
        if 70.0 < off < 110.0 if kind == FRIDGE else off < 20.0 or off > 160.0:
            yield at
    yield from near


def _yaw(right: float, ahead: float) -> float:
    return math.degrees(math.atan2(right, ahead)) % 360.0


def put_at(world: EmbeddedWorld, target: str, *, basin_first: bool = True, strict: bool) -> bool:
    """Put what is held at a target; return whether that was done. The pose stays as tried last.

    With `basin_first` a basin is tried before what is nearer of it and its sink; unless strict it
    always is, since here what lies on a rim lies in no basin. If strict, another object of the type
    is tried after that.
    """
    last = ""
    parts_first = (basin_first or not strict) and root_type(target) in BASIN_OF
    for elsewhere in (False, True) if strict else (False,):
        other_than = last if elsewhere else ""
        for steps in _BEFORE:
            for place in _places(world, target, other_than, parts_first, strict):
                last = place
                _shift(world, steps)
                if _put_there(world, place):
                    return True
    return False


def is_basin(one: Thing) -> bool:
    """Return whether an object is the basin of a sink or bathtub."""
    return one["objectType"] in BASINS


def _places(
    world: EmbeddedWorld, target: str, other_than: str, parts_first: bool, strict: bool
) -> Iterator[str]:
    """Yield what is tried from one pose: the object itself, or the nearest of the type."""
    things = world.last_event.objects
    if is_id(target) and not other_than:
        basins = (one["objectId"] for one in things if is_basin(one))
        yield from (one for one in basins if is_part(one, of=target))
        yield target
        return
    word = root_type(target)
    for parts_only in (parts_first, not parts_first):
        found = nearest(things, word, parts_only=parts_only, other_than=other_than, any_lid=strict)
        if found is not None:
            yield found["objectId"]


def _shift(world: EmbeddedWorld, steps: tuple[tuple[str, int], ...]) -> None:
    for name, times in steps:
        more = {"degrees": _LOOK_DEG} if name.startswith("Look") else {}
        for _ in range(times):
            world.step(name, **more)


def _put_there(world: EmbeddedWorld, place: str) -> bool:
    """Put into what is in view, whether or not its type takes such things."""
    if place not in world.state.sight.visible:
        return False
    return world.step("PutObject", objectId=place, forceAction=True).success
