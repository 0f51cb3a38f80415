"""A goal in loose words -> one in AI2-THOR's types that can come true in a room.

What cannot come true, whatever anybody does there, raises a KarmaError that says why:

* no such type: the name means nothing that AI2-THOR has, or the room has none of it;
* no such state: the thing can never be in it (a sofa is not sliced, a wall not washed);
* no such place: the thing cannot be carried, or the place takes neither it, nor its pieces, nor
  anything in the room that could hold it there.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

from karma.contracts import Goal
from karma.errors import KarmaError
from karma.household.containment import brings, goes_in
from karma.household.pieces import base_type, is_piece, piece_type
from karma.household.states import END_STATES, NEEDS
from karma.household.types import Capability, object_type
from karma.household.uses import BURNER, LAMPS
from karma.tasks.goals import is_position, object_names
from karma.tasks.loose_names import (
    is_plural,
    meaning,
    names,
    number_before,
    state_of,
    tiers_of,
)

_Kinds = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GoalReader:
    """Reads goals for a room, by what that holds at reset."""

    numbers: Counter[str]  # by type

    def read(self, goal: Goal, said: Sequence[str]) -> Goal:
        """Return a goal in types.

        Args:
            goal: with loose names.
            said: its clause, then the whole instruction; how many are meant may stand there.

        Raises:
            KarmaError: it cannot come true; says why.
        """
        found = self._typed(goal)
        return replace(found, count=self._count(goal, found, said))

    # ------------------------------------------------------------- one predicate each

    def _typed(self, goal: Goal) -> Goal:
        if goal.predicate in ("ON", "INSIDE"):
            return self._placement(goal)
        name = object_names(goal)[0]
        if goal.predicate == "STATE":
            word = state_of(goal.arguments[1])
            if word is not None:
                return self._state(name, word)
            if not meaning(goal.arguments[1]):
                raise KarmaError(f"{goal.arguments[1]!r} is neither a state nor an object")
            return self._placement(Goal(predicate="ON", arguments=goal.arguments))
        if goal.predicate == "HOLDON":
            held = self._first(name, lambda kinds: _able(kinds, "pickupable"))
            return Goal(predicate="HOLDON", arguments=("robot", _any(held)))
        need = NEEDS[END_STATES[goal.predicate]]
        kinds = self._first(name, lambda kinds: _able(kinds, need))
        return Goal(predicate=goal.predicate, arguments=(_any(kinds),))

    def _state(self, name: str, word: str) -> Goal:
        """Return a STATE goal; what cannot be cooked must be heated, what no tap reaches clean."""
        try:
            kinds = self._first(name, lambda kinds: _in_state(kinds, word))
        except KarmaError:
            if word != "cooked" or not any(map(self._here, tiers_of(name))):
                raise
            word = "heated"
            kinds = self._first(name, lambda kinds: _in_state(kinds, word))
        if word == "cleaned" and not any(map(_is_carried, kinds)):
            word = "clean"
        return Goal(predicate="STATE", arguments=(_any(kinds), word))

    def _placement(self, goal: Goal) -> Goal:
        """Return a placement whose object can be carried to its place.

        What is "on" a thing that holds nothing is beside it; what a lamp is "on" is held in its
        light.
        """
        name, where = goal.arguments
        if is_position(where):
            moved = self._first(name, lambda kinds: _able(kinds, "pickupable"))
            place = "(" + ", ".join(_numbers(where)) + ")"
            return Goal(predicate="ON", arguments=(_any(moved), place))
        lights, lit = self._some(name), self._some(where)
        if lights and set(lights) <= set(LAMPS) and any(map(_is_carried, lit)):
            return Goal(predicate="HOLDON", arguments=("robot", _any(lit)))
        return self._lying(goal.predicate, name, where)

    def _lying(self, predicate: str, name: str, where: str) -> Goal:
        """Return a placement in the first tiers of both names in which something fits."""
        things, places = self._tiers(name), self._tiers(where)
        reason: KarmaError | None = None
        for tier, there in product(things, places):
            try:
                moved = _able(tier, "pickupable")
                holding = self._holding(there)
            except KarmaError as error:
                reason = reason or error
                continue
            if holding and (pairs := [p for p in product(moved, holding) if self._goes(*p)]):
                both = (_any(tuple(dict.fromkeys(kinds))) for kinds in zip(*pairs, strict=True))
                return Goal(predicate=predicate, arguments=tuple(both))
            if not holding:
                return Goal(predicate="ON", arguments=(_any(moved), _any(there)))
            reason = reason or KarmaError(f"AI2-THOR lets no {_any(moved)} into {_any(holding)}")
        raise reason or KarmaError(f"nothing called {name} goes to {where}")

    def _holding(self, kinds: _Kinds) -> _Kinds:
        """Return the receptacles among types, or what they stand for; () where "on" is beside."""
        receptacles = tuple(kind for kind in kinds if object_type(kind).can("receptacle"))
        stands_for = (names().stands_for.get(kind) for kind in kinds)
        return receptacles or self._here(tuple(kind for kind in stands_for if kind))

    def _goes(self, moved: str, place: str) -> bool:
        """Return whether a thing can be got to a place, whole, cut, or in something it lies in."""
        kinds = {moved, piece_type(moved)}
        return any(
            goes_in(kind, place) or any(brings(vessel, kind, place) for vessel in self.numbers)
            for kind in kinds
        )

    # ------------------------------------------------------------- names

    def _here(self, kinds: _Kinds) -> _Kinds:
        return tuple(k for k in kinds if self.numbers[k] or self.numbers[base_type(k)])

    def _tiers(self, name: str) -> list[_Kinds]:
        """Return what the room has of each tier of a name."""
        tiers = tiers_of(name)
        if not tiers:
            raise KarmaError(f"no object type is called {name!r}")
        if found := [here for tier in tiers if (here := self._here(tier))]:
            return found
        raise KarmaError(f"the scene has no {_any(tuple(k for tier in tiers for k in tier))}")

    def _some(self, name: str) -> _Kinds:
        """Return what the room has of the first tier of a name that it has any of; () for none."""
        return next((here for tier in tiers_of(name) if (here := self._here(tier))), ())

    def _first(self, name: str, chosen: Callable[[_Kinds], _Kinds]) -> _Kinds:
        """Return what is chosen of the first tier of a name of which anything can be."""
        reason: KarmaError | None = None
        for kinds in self._tiers(name):
            try:
                return chosen(kinds)
            except KarmaError as error:
                reason = reason or error
        raise reason or KarmaError(f"no object type is called {name!r}")

    # ------------------------------------------------------------- numbers

    def _count(self, goal: Goal, found: Goal, said: Sequence[str]) -> int:
        """Return of how many things a goal speaks, at most so many as there are."""
        name = object_names(goal)[0]
        if found.predicate == "HOLDON" or not (goal.count > 1 or is_plural(name)):
            return 1
        spoken = (number_before(name, text) for text in (f"{name} {name}", *said))
        wanted = max(goal.count, next((n for n in spoken if n > 1), 2))
        return max(1, min(wanted, sum(map(self._number, found_kinds(found)))))

    def _number(self, kind: str) -> int:
        whole = object_type(base_type(kind))
        pieces = self.numbers[whole.name] * whole.slice_count if is_piece(kind) else 0
        return self.numbers[kind] + pieces


def found_kinds(goal: Goal) -> _Kinds:
    """Return the types that a resolved goal allows for its object."""
    return tuple(object_names(goal)[0].split("/"))


def _any(kinds: Sequence[str]) -> str:
    return "/".join(kinds)


def _able(kinds: _Kinds, capability: Capability) -> _Kinds:
    """Return the types with a capability, their slices' included."""
    able = tuple(
        kind
        for kind in kinds
        if object_type(kind).can(capability)
        or object_type(piece_type(kind)).can(capability)
        or (capability == "toggleable" and kind == BURNER)
    )
    if not able:
        raise KarmaError(f"{_any(kinds)} is not {capability}")
    return able


def _in_state(kinds: _Kinds, word: str) -> _Kinds:
    """Return the types that can be in a state.

    Clean is what is not dirty or was rinsed; hot and cold things were carried to where they are so.
    """
    if word == "filled":  # under a tap, or in a coffee machine
        kinds = _able(kinds, "pickupable")
    if word in NEEDS:
        return _able(kinds, NEEDS[word])
    flags: Sequence[Capability] = ("pickupable",)
    if word in ("clean", "cleaned"):
        flags = ("dirtyable", "pickupable")
    elif word == "empty":
        flags = ("receptacle", "canFillWithLiquid")
    able = tuple(k for k in kinds if any(object_type(k).can(flag) for flag in flags))
    if not able:
        raise KarmaError(f"{_any(kinds)} is never {word}")
    return able


def _is_carried(kind: str) -> bool:
    return object_type(kind).can("pickupable")


def _numbers(place: str) -> list[str]:
    numbers = re.findall(r"-?\d+(?:\.\d+)?", place)
    if len(numbers) != 3:
        raise KarmaError(f"{place} is no position (x, y, z)")
    return numbers
