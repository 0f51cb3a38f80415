"""What a program brings about if all of its calls succeed, by object types.

The request checker compares it with the request before the first call.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from karma.household.places import FLOOR, HAND
from karma.household.skill_effects import BeliefChange, BeliefState, Item, changes
from karma.household.uses import BIN, kind_of, switch_of
from karma.types.planning import SkillCall

_DEEDS: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "cleaned": ("wash",), "filled": ("fill",), "coffee": ("coffee",), "empty": ("empty",),
    "heated": ("heat", "cook"), "cooked": ("cook",), "toasted": ("toast",), "cooled": ("cool",),
    "sliced": ("slice",), "broken": ("break",),
})  # state -> what people call bringing it about  # fmt: skip
_SWITCHED = ("on", "off")
_DOORS = {"opened": "open", "closed": "close"}


@dataclass(slots=True)
class ProgramEffects:
    """What a program adds up to; kinds are types of wholes (`kind_of`)."""

    beliefs: BeliefState  # after the last call
    began: Item | None = None  # what was held before
    near: set[Item] = field(default_factory=set)  # put beside it, not in or on it
    passed: dict[Item, list[str]] = field(default_factory=dict)  # kinds of all places, in order
    ever: set[tuple[str, Item]] = field(default_factory=set)  # ("slice", item), undone or not
    ran: set[str] = field(default_factory=set)  # kinds that were on at some time
    opened: set[str] = field(default_factory=set)
    visited: set[str] = field(default_factory=set)  # kinds of all that it names
    switched: dict[str, str] = field(default_factory=dict)  # kind -> "on", "off", as it is left
    doors: dict[str, str] = field(default_factory=dict)  # kind -> "open", "close", as it is left

    @property
    def at(self) -> Mapping[Item, str]:
        """Moved items, and the kind of the last place of each."""
        return {item: kind_of(place.name) for item, place in self.beliefs.places.items()}

    @property
    def deeds(self) -> set[tuple[str, Item]]:
        """What was done to items and not undone: ("slice", item)."""
        states = self.beliefs.states.items()
        left = {(deed, item) for item, words in states for word in words
                for deed in _DEEDS.get(word, ())}  # fmt: skip
        return left | {one for one in self.ever if one[0] in ("throw", "fling")}

    def places(self, item: Item) -> frozenset[str]:
        """Return the kinds of what an item is in, on or beside at the end, and of what holds that.

        `HAND` for what is held.
        """
        place = self.beliefs.places.get(item)
        if place is not None and place.beside:
            return frozenset((kind_of(place.name), *self.beliefs.within(Item(place.name))))
        return self.beliefs.within(item)

    def did(self, deed: str, kinds: Iterable[str], *, undone: bool = False) -> bool:
        """Return whether something was done to an item of some kinds; `undone`: undone or not."""
        wanted, deeds = set(kinds), self.ever if undone else self.deeds
        return any(done == deed and kind_of(item.name) in wanted for done, item in deeds)

    def of(self, kinds: Iterable[str]) -> list[Item]:
        """Return the moved items of some kinds."""
        wanted = set(kinds)
        return [item for item in self.beliefs.places if kind_of(item.name) in wanted]


def effects_of(calls: Sequence[SkillCall], held: str | None = None) -> ProgramEffects:
    """Return what a program brings about."""
    beliefs = BeliefState.holding(held)
    found = ProgramEffects(beliefs, began=beliefs.held)
    for call in calls:
        found.visited.update(map(kind_of, call.objects))
        made = changes(call, found.beliefs)
        found.beliefs = found.beliefs.changed(made)
        for change in made:
            _note(found, change)
    return found


def _note(found: ProgramEffects, change: BeliefChange) -> None:
    item, kind = change.item, kind_of(change.item.name)
    if (place := change.place) is not None:
        there = kind_of(place.name)
        if place.name == FLOOR:  # wherever it flies, into no bin
            found.ever.add(("fling", item))
        elif there != HAND:
            found.passed.setdefault(item, []).append(there)
            (found.near.add if place.beside else found.near.discard)(item)
            if there == BIN and not place.beside:
                found.ever.add(("throw", item))
    elif change.state in _SWITCHED:
        found.switched[switch_of(kind)] = change.state
        if change.state == "on":
            found.ran.add(switch_of(kind))
    elif change.state in _DOORS:
        found.doors[kind] = _DOORS[change.state]
        if change.state == "opened":
            found.opened.add(kind)
    found.ever.update((deed, item) for deed in _DEEDS.get(change.state, ()))
