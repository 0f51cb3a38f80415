"""HELPER's object memory: every object that was seen, by id, over one sequence of instructions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from karma.agent.body.sightings import known
from karma.agent.planning.program import DOOR_AFTER
from karma.agent.seeing.perceive import place_of
from karma.contracts import Area, Experience, Known, SeenObject, SkillCall, Vec3
from karma.household.pieces import base_type, goes_by, is_piece
from karma.household.places import HAND, surface_for
from karma.household.types import object_types
from karma.household.uses import KNIVES, MICROWAVE, covers

_SEEN, _PLACED = 1.0, 1.01  # what was put down by oneself is surer than what was seen
_LESS = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked:
    """One object: its last sight, how sure it is, and whether it may be used."""

    sight: SeenObject
    score: float = _SEEN  # the best is tried first
    holding: bool = False
    can_use: bool = True  # False once it is where this instruction wanted it


@dataclass(slots=True)
class ObjectMemory:
    """Keeps every object of one room that was seen; nothing is dropped for room.

    It is also what the skills may ask: where a name is. A name is an id or a type; a type means the
    pieces of a thing too.
    """

    here: Callable[[], Vec3]  # where the agent stands
    objects: dict[str, Tracked] = field(default_factory=dict)
    could_not_find: set[str] = field(default_factory=set)

    def begin_instruction(self) -> None:
        """Allow every object to be used and searched for again."""
        self.could_not_find.clear()
        self.objects = {name: replace(one, can_use=True) for name, one in self.objects.items()}

    # ------------------------------------------------------------- writing

    def observe(self, experience: Experience) -> None:
        """Take in the latest sights; what was missed or cut is forgotten."""
        lost = experience.missed | experience.cut
        held = experience.held.object_id if experience.held else None
        for object_id, sight in experience.seen.items():
            if object_id in lost:
                continue
            before = self.objects.get(object_id, Tracked(sight=sight))
            self.objects[object_id] = replace(before, sight=sight, holding=object_id == held)
        for object_id in lost:
            self.objects.pop(object_id, None)

    def placed(self, object_id: str) -> None:
        """Note that a thing was put down."""
        self._change(object_id, score=_PLACED)

    def finish(self, object_id: str) -> None:
        """Mark a thing that is where this instruction wants it, so that it is not used again."""
        self._change(object_id, can_use=False)

    def failed(self, object_id: str) -> None:
        """Lower the score of an object that an action failed on; others of its type come first."""
        if object_id in self.objects:
            kind = self.objects[object_id].sight.object_type
            scores = [o.score for o in self.objects.values() if o.sight.object_type == kind]
            self._change(object_id, score=min(scores) - _LESS)

    def _change(self, object_id: str, **said: Any) -> None:
        if object_id in self.objects:
            self.objects[object_id] = replace(self.objects[object_id], **said)

    # ------------------------------------------------------------- reading

    def of(self, name: str) -> list[Tracked]:
        """Return the objects that a name can mean, by score, then by distance."""
        x, _, z = self.here()

        def rank(one: Tracked) -> tuple[bool, float, float, str]:
            at = one.sight.box_center_m
            gap = (at[0] - x) ** 2 + (at[2] - z) ** 2
            return not one.holding, -one.score, round(gap, 4), one.sight.object_id

        fitting = [one for one in self.objects.values() if one.can_use and _means(name, one.sight)]
        return sorted(fitting, key=rank)

    def best(self, name: str) -> Tracked | None:
        """Return the best object that a name can mean; None without a usable one."""
        return next(iter(self.of(name)), None)

    def where(self, name: str) -> Known | None:
        """Return the best known place of an id or type."""
        one = self.objects.get(name) or self.best(name)
        return known(one.sight, "memory") if one is not None else None

    def areas(self) -> tuple[Area, ...]:
        """Return no areas: HELPER has no long-term map."""
        return ()

    def shut_in(self, name: str) -> SeenObject | None:
        """Return the closed receptacle that a thing was last seen in, if any."""
        one = self.objects.get(name)
        place = place_of(one.sight) if one is not None else None
        if one is None or one.holding or place is None or place == HAND:
            return None
        holder = self.objects.get(place)
        return holder.sight if holder is not None and "closed" in holder.sight.states else None


def _means(name: str, sight: SeenObject) -> bool:
    return name == sight.object_id or covers(name, sight.object_type)


_SHUT_TO_RUN = (MICROWAVE,)


def without_object(
    call: SkillCall, held: SeenObject | None, memory: ObjectMemory
) -> list[SkillCall]:
    """Return what to do before the sub-goal's own object is looked for.

    * Before something else is picked up, the held thing is put down.
    * Before a cut, a knife is fetched.

    The sub-goal has types for names.
    """
    name = call.objects[-1]
    means_held = held is not None and goes_by(name, held.object_id, held.object_type)
    if call.skill == "PickupObject" and held is not None and not means_held:
        return [_put_down(held, memory)]
    if call.skill == "SliceObject" and (held is None or held.object_type not in KNIVES):
        first = [_put_down(held, memory)] if held is not None else []
        knife = next((name for name in KNIVES if memory.best(name) is not None), KNIVES[0])
        return [*first, SkillCall.of("PickupObject", knife)]
    return []


def with_object(call: SkillCall, memory: ObjectMemory) -> list[SkillCall]:
    """Return what to do once the ids of a sub-goal are known: open what is shut, or shut it."""
    name = call.objects[-1]
    if call.skill in ("PickupObject", "SliceObject", "BreakObject"):
        holder = memory.shut_in(name)
        return [SkillCall.of("OpenObject", holder.object_id)] if holder is not None else []
    one = memory.objects.get(name)
    if one is None:
        return []
    states, kind = one.sight.states, object_types()[one.sight.object_type]
    if call.skill == "PutObject" and kind.must_be_open and "closed" in states:
        return [SkillCall.of("OpenObject", name)]
    if call.skill == "ToggleOn" and kind.name in _SHUT_TO_RUN and "opened" in states:
        return [SkillCall.of("CloseObject", name)]
    return []


def idle(call: SkillCall, memory: ObjectMemory) -> bool:
    """Return whether to drop an open or close of an id: it does not open, or is so already."""
    one = memory.objects.get(call.objects[-1])
    if call.skill not in DOOR_AFTER or one is None:
        return False
    return (
        not object_types()[one.sight.object_type].can("openable")
        or DOOR_AFTER[call.skill] in one.sight.states
    )


def whole_first(call: SkillCall, memory: ObjectMemory) -> SkillCall | None:
    """Return the cut that must come first where a sub-goal names a piece not cut yet."""
    for name in call.objects:
        if is_piece(name) and memory.best(name) is None and call.skill != "SliceObject":
            return SkillCall.of("SliceObject", base_type(name))
    return None


def ends_there(call: SkillCall, rest: Sequence[SkillCall]) -> bool:
    """Return whether a thing that is put down has reached its goal (HELPER's ObjectDone).

    So it is when the rest of the program does not use it, or puts another one to the same place.
    """
    thing, place = call.objects[0], call.objects[-1]
    for later in rest:
        if later.skill == "PutObject" and later.objects[0] == thing:
            return later.objects[-1] == place
    return not any(thing in later.objects for later in rest)


def _put_down(held: SeenObject, memory: ObjectMemory) -> SkillCall:
    surface = surface_for(held.object_type, lambda name: memory.best(name) is not None)
    return SkillCall.of("PutObject", held.object_id, surface)
