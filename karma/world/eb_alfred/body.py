"""Carry out the benchmark's actions in our world; each ends in "" or in what went wrong.

What differs with `strict` is listed in docs/alfred-benchmarks.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from karma.household.ids import is_part, root_type, type_of
from karma.household.uses import BASIN_OF, FAUCET, SINK
from karma.world.alfred.goal import Deeds, noteworthy
from karma.world.eb_alfred.actions import NumberedAction
from karma.world.eb_alfred.choosing import Thing, by_id, nearest
from karma.world.eb_alfred.going import go_to
from karma.world.eb_alfred.protocol import EB_ALFRED, RoomProtocol
from karma.world.eb_alfred.putting import is_basin, put_at
from karma.world.event import WorldEvent
from karma.world.sim import EmbeddedWorld

_OPENINGS = (("MoveBack",), ("MoveBack", "MoveRight"), ("MoveLeft", "MoveLeft"), ())


@dataclass(slots=True)
class Body:
    """The robot in one episode.

    Args:
        world: at the start of the trial.
        names: what objects are called of which there are several.
        protocol: of the benchmark.
        strict: follow the source where it is odd.
        puts: how often was put at which target; in the source it outlives the episode.
    """

    world: EmbeddedWorld
    names: Mapping[str, str]
    protocol: RoomProtocol = EB_ALFRED
    strict: bool = False
    puts: dict[str, int] = field(default_factory=dict)
    deeds: Deeds = field(default_factory=lambda: Deeds(agreeing=False))
    target: str = ""  # of a put: id or type of what was found last
    cutting: bool = False  # something was to be cut: pieces come first

    def act(self, action: NumberedAction) -> str:
        """Do one action."""
        if action.verb not in ("put", "open"):
            self.target = ""
        match action.verb:
            case "find":
                return self._find(action)
            case "pick up":
                return self._pick_up(action.noun)
            case "put":
                return self._put()
            case "drop":
                return self._drop()
            case "open":
                return self._open(action)
            case "close":
                return self._close(action)
            case "slice":
                return self._slice(action.noun)
            case _:
                return self._switch(action.noun, on=action.verb == "turn on")

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
        thing = self._nearest(_word(action), by_sight=True, pieces_first=self.cutting)
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
        if not event.success:
            return f"turning {word} failed"
        if (
            self.strict
            and on
            and noun == FAUCET
            and not any(
                one["objectType"] == BASIN_OF[SINK] and one["visible"] for one in self._things
            )
        ):
            return f"turning {word} failed"  # it is on, but the source stumbles over the basin
        return ""

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


def _word(action: NumberedAction) -> str:
    return root_type(action.object_id) if action.object_id else action.noun
