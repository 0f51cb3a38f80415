"""HELPER's object memory: every object that was seen, by id, over one sequence of instructions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from karma.agent.planning.program import DOOR_AFTER
from karma.household.pieces import base_type, goes_by, is_piece
from karma.household.skill_effects import BeliefState, Item, unmet
from karma.household.types import object_types
from karma.household.uses import KNIVES, covers
from karma.plugins.baselines.baseline import RoomMemory
from karma.types.memory import Experience
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall

_SEEN, _PLACED = 1.0, 1.01  # what was put down by oneself is surer than what was seen
_LESS = 0.01


@dataclass
class ObjectMemory(RoomMemory):
    """Keeps every object that was seen; a type means the pieces of a thing too."""

    scores: dict[str, float] = field(default_factory=dict)  # id -> how sure; the best comes first
    finished: set[str] = field(default_factory=set)  # ids, where this instruction wants them
    could_not_find: set[str] = field(default_factory=set)
    held_id: str | None = None
    explored: bool = False  # the room was looked round once

    def begin_instruction(self) -> None:
        """Allow every object to be used and searched for again."""
        self.could_not_find.clear()
        self.finished.clear()

    # ------------------------------------------------------------- writing

    def observe(self, experience: Experience) -> None:
        """Take in the latest sights; what was missed or cut is forgotten."""
        super().observe(experience)
        self.held_id = experience.held.object_id if experience.held else None
        for object_id in {*experience.missed, *experience.cut}:
            self.scores.pop(object_id, None)
            self.finished.discard(object_id)

    def placed(self, object_id: str) -> None:
        """Note that a thing was put down."""
        if object_id in self.seen:
            self.scores[object_id] = _PLACED

    def finish(self, object_id: str) -> None:
        """Mark a thing that is where this instruction wants it, so that it is not used again."""
        if object_id in self.seen:
            self.finished.add(object_id)

    def failed(self, object_id: str) -> None:
        """Lower the score of an object that an action failed on; others of its type come first."""
        if object_id in self.seen:
            kind = self.seen[object_id].object_type
            alike = [name for name, one in self.seen.items() if one.object_type == kind]
            self.scores[object_id] = min(map(self._score, alike)) - _LESS

    def _score(self, object_id: str) -> float:
        return self.scores.get(object_id, _SEEN)

    # ------------------------------------------------------------- reading

    def of(self, name: str) -> list[SeenObject]:
        """Return the objects that a name can mean: what is held, by score, then by distance."""
        x, _, z = self.here()

        def rank(one: SeenObject) -> tuple[bool, float, float, str]:
            at = one.box_center_m
            gap = (at[0] - x) ** 2 + (at[2] - z) ** 2
            held = one.object_id == self.held_id
            return not held, -self._score(one.object_id), round(gap, 4), one.object_id

        usable = [one for one in self.seen.values() if one.object_id not in self.finished]
        meant = (o for o in usable if name == o.object_id or covers(name, o.object_type))
        return sorted(meant, key=rank)

    def best(self, name: str) -> SeenObject | None:
        """Return the best object that a name can mean; None without a usable one."""
        return next(iter(self.of(name)), None)


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
    hand = name if means_held else (held.object_id if held is not None else None)
    needs = unmet(call, BeliefState.holding(hand))
    if "empty hand" in needs and held is not None:
        return [_put_down(held, memory)]
    if "knife" in needs:
        first = [_put_down(held, memory)] if held is not None else []
        knife = next((name for name in KNIVES if memory.best(name) is not None), KNIVES[0])
        return [*first, SkillCall.of("PickupObject", knife)]
    return []


def with_object(call: SkillCall, memory: ObjectMemory) -> list[SkillCall]:
    """Return what to do once the ids of a sub-goal are known: open what is shut, or shut it."""
    name = call.objects[-1]
    if call.skill in ("PickupObject", "SliceObject", "BreakObject"):
        inside = memory.seen.get(name)
        holder = memory.shut_in(inside) if inside and name != memory.held_id else None
        return [SkillCall.of("OpenObject", holder.object_id)] if holder is not None else []
    one = memory.seen.get(name)
    if one is None:
        return []
    needs = unmet(call, BeliefState(states={Item(name): frozenset(one.states)}))
    if "opened" in needs:
        return [SkillCall.of("OpenObject", name)]
    return [SkillCall.of("CloseObject", name)] if "closed" in needs else []


def idle(call: SkillCall, memory: ObjectMemory) -> bool:
    """Return whether to drop an open or close of an id: it does not open, or is so already."""
    one = memory.seen.get(call.objects[-1])
    if call.skill not in DOOR_AFTER or one is None:
        return False
    return (
        not object_types()[one.object_type].can("openable") or DOOR_AFTER[call.skill] in one.states
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
    return SkillCall.of("PutObject", held.object_id, memory.surface(held.object_type))
