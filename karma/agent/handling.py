"""What the hand does: pick up, put down, throw, pour out, slice, open, close, break."""

from contextlib import suppress

from karma.agent.reach import Reach
from karma.agent.refusals import RefusedError, hand_full, put_refused
from karma.agent.sightings import known, means
from karma.contracts import Known, SeenObject
from karma.household.ids import part_id
from karma.household.pieces import is_piece
from karma.household.states import DOOR_AFTER, OPPOSITES
from karma.household.types import object_types
from karma.household.uses import BASIN_OF

THROW_FORCE = 100.0  # AI2-THOR's moveMagnitude
_OTHER_RECEPTACLES = 3  # tried when the one that was meant is full


class Handling:
    """Skills of the hand; each returns a remark, and raises `RefusedError` with its reason.

    Args:
        reach: the body, its log and the agent's memory.
    """

    def __init__(self, reach: Reach) -> None:
        self._reach, self._log, self._walker = reach, reach.log, reach.walker

    def pick_up(self, name: str) -> str:
        """Take a thing into the empty hand."""
        held = self._log.held
        if held is None:
            self._reach.act(self._reach.resolve(name), "PickupObject")
            return ""
        if means(name, held):
            return "it is in the hand already"
        kind = held.object_type
        raise RefusedError(
            f"the hand holds {kind}; put it down first, "
            f"e.g. PutObject(robot, '{kind}', 'CounterTop')",
            hand_full(held, self._reach.known_types()),
        )

    def put(self, thing: str | None, name: str, *, exact: bool = False) -> str:
        """Put what is held, which must be `thing` if that is given, into or onto a receptacle.

        One that is full gives way to another of its type, unless it is `exact`, or a thing that is
        carried about and was named by its id.
        """
        held = self._held(thing)
        target = self._reach.resolve(name, state="opened", held=False)
        try:
            self._put_into(held, target)
        except RefusedError as refusal:
            others = self._reach.names.others(target)
            if "No valid position" in str(refusal) and not exact and _is_one_of(name, target):
                for other in others[:_OTHER_RECEPTACLES]:
                    with suppress(RefusedError):
                        self._put_into(held, other)
                        return f"the nearest {target.object_type} is full, another one was taken"
            types = self._reach.known_types()
            detail = put_refused(str(refusal), held, target, others, self._log, types)
            raise RefusedError(str(refusal), detail or refusal.detail) from None
        return ""

    def throw(self, name: str) -> str:
        """Throw away what is held."""
        held = self._held(name)
        event = self._walker.do("ThrowObject", moveMagnitude=THROW_FORCE)
        self._reach.done(known(held, "held"), event)
        return ""

    def empty(self, name: str) -> str:
        """Pour out what a vessel holds; one that is empty is left as it is."""
        target = self._reach.resolve(name)
        try:
            self._reach.act(target, "EmptyLiquidFromObject")
        except RefusedError as refusal:
            if "already empty" not in str(refusal):
                raise
            return "it is empty already"
        self._log.end(target.object_id, "filled")
        return ""

    def slice(self, name: str) -> str:
        """Cut a thing; what has been cut already is left."""
        target = self._reach.resolve(name)
        if is_piece(target.object_type):
            self._reach.use(target)
            return "it is sliced already"
        self._log.sliced(target.object_id, self._reach.act(target, "SliceObject"))
        return ""

    def act(self, skill: str, name: str) -> str:
        """Do one action on a thing: open, close, break."""
        wanted = OPPOSITES.get(DOOR_AFTER.get(skill, ""), "")
        target = self._reach.resolve(name, state=wanted)
        self._reach.approach(target)
        sight = self._log.seen[target.object_id]
        if skill == "CloseObject" and "closed" in self._log.states(sight):
            return "it is closed already"
        self._reach.act(target, skill)
        return ""

    def _held(self, name: str | None) -> SeenObject:
        """Return what is held; refuse when that is nothing, or not what the name means."""
        held = self._log.held
        if held is None:
            raise RefusedError(f"the hand is empty; PickupObject(robot, '{name or '...'}') first")
        if name is not None and not means(name, held):
            put_down = hand_full(held, self._reach.known_types())
            raise RefusedError(
                f"the hand holds {held.object_type}, not {name}",
                f"{put_down}, then PickupObject(robot, '{name}')",
            )
        return held

    def _put_into(self, held: SeenObject, target: Known) -> None:
        """Put down where the basin, if the target has one, has come into view."""
        self._reach.approach(self._basin(target) or target)
        tried = [self._walker.stance()]
        while (place := self._basin(target)) is None:
            if len(tried) > self._reach.limits.views or not self._reach.next_stance(target, tried):
                place = target
                break
        self._reach.act(place, "PutObject", also=held.object_id)

    def _basin(self, target: Known) -> Known | None:
        """Return where things are put: a sink's basin, None while it is not known."""
        basin = BASIN_OF.get(target.object_type)
        return self._reach.names.find(part_id(target.object_id, basin)) if basin else target


def _is_one_of(name: str, target: Known) -> bool:
    """Return whether a receptacle was named by its type, or is furniture."""
    kind = object_types().get(target.object_type)
    return name == target.object_type or (kind is not None and not kind.can("pickupable"))
