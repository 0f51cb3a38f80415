"""Goals that nobody can meet in a room: objects that are absent, out of reach or too big."""

from collections.abc import Iterable, Sequence

import msgspec

from karma.agent.seeing.perceive import cells_of
from karma.goals.goals import alternatives, object_names
from karma.household.containment import fits_whole_or_cut
from karma.household.ids import is_position
from karma.household.uses import covers
from karma.types.tasks import Goal
from karma.world.core.placement import find_place
from karma.world.core.scene import Scene, SceneObject
from karma.world.sim import EmbeddedWorld

NOT_THERE = "a thing is not in the room"
TAKES_NONE = "nothing that is named as the place takes such a thing"
OUT_OF_REACH = "a thing or place is within reach from nowhere that one can stand"
TOO_BIG = "a thing is too big for its place, even when that is empty"


class Possible:
    """Check goals against one room."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._bare = [_opened(one) for one in scene.objects if not _is_loose(one)]
        self._reached: dict[str, bool] = {}
        self._taken: dict[tuple[str, str], bool] = {}

    def refusal(self, goals: Iterable[Goal]) -> str:
        """Return why one of the goals can be met by nobody, "" where all can."""
        return next(filter(None, map(self._why_not, goals)), "")

    def _why_not(self, goal: Goal) -> str:
        named = [self._objects_named(name) for name in object_names(goal)]
        if not all(named):
            return NOT_THERE
        if not all(any(map(self._is_reached, ones)) for ones in named):
            return OUT_OF_REACH
        if goal.predicate not in ("ON", "INSIDE") or is_position(goal.arguments[1]):
            return ""
        things, places = named
        pairs = [(thing, place) for thing in things for place in places if _takes(place, thing)]
        if not pairs:
            return TAKES_NONE
        return "" if any(self._is_taken(*pair) for pair in pairs) else TOO_BIG

    def _objects_named(self, name: str) -> Sequence[SceneObject]:
        kinds = alternatives(name)
        return [one for one in self._scene.objects if any(covers(k, one.type) for k in kinds)]

    def _is_reached(self, thing: SceneObject) -> bool:
        """Return whether a thing can be seen within reach from somewhere."""
        if thing.id not in self._reached:
            world = EmbeddedWorld(self._with([thing]))
            asked = world.step("GetInteractablePoses", objectId=thing.id)
            self._reached[thing.id] = bool(cells_of(asked))
        return self._reached[thing.id]

    def _is_taken(self, thing: SceneObject, place: SceneObject) -> bool:
        """Return whether a place that can be got at has room for a thing once it is empty.

        Of what is cut a piece may fit where the whole does not.
        """
        if "sliceable" in thing.capabilities:
            return self._is_reached(place)
        if (thing.id, place.id) not in self._taken:
            state = EmbeddedWorld(self._with([place])).state
            there = state.objects[place.id]
            room = thing.id != place.id and find_place(state, thing, there) is not None
            self._taken[thing.id, place.id] = room and self._is_reached(place)
        return self._taken[thing.id, place.id]

    def _with(self, loose: Sequence[SceneObject]) -> Scene:
        """Return the room with its doors open and, of what can be moved, nothing but this."""
        there = {one.id: one for one in (*self._bare, *map(_opened, loose))}
        lying = (
            msgspec.structs.replace(one, parents=tuple(p for p in one.parents if p in there))
            for one in there.values()
        )
        return msgspec.structs.replace(self._scene, objects=tuple(lying))


def _is_loose(thing: SceneObject) -> bool:
    return "pickupable" in thing.capabilities


def _takes(place: SceneObject, thing: SceneObject) -> bool:
    """Return whether a place holds things, and its type takes a thing whole or in pieces."""
    return "receptacle" in place.capabilities and fits_whole_or_cut(thing.type, place.type)


def _opened(thing: SceneObject) -> SceneObject:
    doors = "openable" in thing.capabilities and "receptacle" in thing.capabilities
    return msgspec.structs.replace(thing, openness=1.0) if doors else thing
