"""Effects of skills: what each needs, adds and deletes, and one function that applies a call.

A plan is checked, repaired, written and reported on by these facts alone. They are facts of object
names: a name is an object id, a type or a prompt's short name. The table is about calls that
succeed; the world decides whether they do.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, NamedTuple, Self

from karma.household.ids import short_type, type_of
from karma.household.pieces import piece_type
from karma.household.places import FLOOR, HAND
from karma.household.types import Capability, object_types, types_with
from karma.household.uses import (
    BURNER,
    COFFEE_CUP,
    COFFEE_MACHINE,
    COOKWARE,
    FRIDGE,
    KNIVES,
    MICROWAVE,
    TAP_OF,
    TAPS,
    TOASTED,
    TOASTER,
    kind_of,
)
from karma.types.planning import SkillCall

Need = Literal["empty hand", "held", "not held", "knife", "opened", "closed", "off"]
_CLOSED_TO_RUN = (MICROWAVE,)
_IN_PIECES = frozenset(("sliced", "broken"))
_DEPTH = 5  # receptacles within receptacles that are followed


@dataclass(frozen=True, slots=True, kw_only=True)
class SkillEffect:
    """Precondition and effects of one skill on its object."""

    needs: tuple[Need, ...] = ()
    takes: Capability | Literal[""] = ""  # of the last object, or of the only one
    moves: Literal["", "hand", "receptacle", "beside", "floor"] = ""  # where the object then lies
    adds: tuple[str, ...] = ()  # states of the object
    deletes: tuple[str, ...] = ()


_ON = SkillEffect(needs=("closed",), takes="toggleable", adds=("on",), deletes=("off",))
_OFF = SkillEffect(takes="toggleable", adds=("off",), deletes=("on",))
SKILL_EFFECTS: Mapping[str, SkillEffect] = MappingProxyType({
    "GoToObject": SkillEffect(),
    "Explore": SkillEffect(),
    "PickupObject": SkillEffect(needs=("empty hand",), takes="pickupable", moves="hand"),
    "PutObject": SkillEffect(needs=("held", "opened"), moves="receptacle"),
    "PutNear": SkillEffect(needs=("held",), moves="beside"),
    "ThrowObject": SkillEffect(needs=("held",), moves="floor"),
    "OpenObject": SkillEffect(
        needs=("off",), takes="openable", adds=("opened",), deletes=("closed",)
    ),
    "CloseObject": SkillEffect(
        needs=("off",), takes="openable", adds=("closed",), deletes=("opened",)
    ),
    "SwitchOn": _ON,
    "SwitchOff": _OFF,
    "ToggleOn": _ON,
    "ToggleOff": _OFF,
    "SliceObject": SkillEffect(needs=("knife",), takes="sliceable", adds=("sliced",)),
    "BreakObject": SkillEffect(needs=("not held",), takes="breakable", adds=("broken",)),
    "EmptyObject": SkillEffect(
        takes="canFillWithLiquid", adds=("empty",), deletes=("filled", "coffee")
    ),
})  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SideEffect:
    """Effect of an object that comes into a state on what lies in some receptacles."""

    state: str
    of: frozenset[str]  # object types, as of `kind_of`
    within: frozenset[str]  # receptacle types
    to: frozenset[str] | None = None  # object types that change, exactly; None: all
    adds: tuple[str, ...]
    deletes: tuple[str, ...] = ()


def _heat(of: str, *within: str) -> SideEffect:
    return SideEffect(
        state="on", of=frozenset((of,)), within=frozenset((of, *within)),
        adds=("heated",), deletes=("cooled",),
    )  # fmt: skip


def _cook(of: str, *within: str, to: frozenset[str], adds: tuple[str, ...]) -> SideEffect:
    return SideEffect(
        state="on", of=frozenset((of,)), within=frozenset((of, *within)), to=to, adds=adds
    )


_TAPS, _BASINS = frozenset((*TAPS, *TAP_OF)), frozenset(TAP_OF)
_COOKABLE = types_with("cookable")
_BREAD = frozenset((TOASTED, piece_type(TOASTED)))  # only slices fit into a toaster
SIDE_EFFECTS: tuple[SideEffect, ...] = (
    SideEffect(state="on", of=_TAPS, within=_BASINS, adds=("cleaned",), deletes=("dirty",)),
    SideEffect(
        state="on", of=_TAPS, within=_BASINS, to=types_with("canFillWithLiquid"),
        adds=("filled",), deletes=("empty",),
    ),
    _heat(MICROWAVE),
    _cook(MICROWAVE, to=_COOKABLE - _BREAD, adds=("cooked",)),
    _heat(BURNER, *COOKWARE),
    _cook(BURNER, *COOKWARE, to=_COOKABLE, adds=("cooked",)),
    _heat(TOASTER),
    _cook(TOASTER, to=_BREAD, adds=("cooked", "toasted")),
    _cook(COFFEE_MACHINE, to=frozenset((COFFEE_CUP,)), adds=("filled", "coffee", "heated")),
    SideEffect(
        state="closed", of=frozenset((FRIDGE,)), within=frozenset((FRIDGE,)),
        adds=("cooled",), deletes=("heated",),
    ),
)  # fmt: skip


# ----------------------------------------------------------------- beliefs


class Item(NamedTuple):
    """An object as a program names it: a name, and which of several of that name."""

    name: str
    turn: int = 0


class ItemPlace(NamedTuple):
    """Where an object lies: the name of a receptacle, `HAND` or `FLOOR`; or beside something."""

    name: str
    beside: bool = False


class BeliefChange(NamedTuple):
    """A fact that a call adds to beliefs about one object, and the states that it deletes."""

    item: Item
    state: str = ""
    place: ItemPlace | None = None
    deletes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BeliefState:
    """Where objects are that were moved, and which states are known of objects.

    Both mappings are in order of the last change.
    """

    held: Item | None = None
    places: Mapping[Item, ItemPlace] = field(default_factory=dict)
    states: Mapping[Item, frozenset[str]] = field(default_factory=dict)

    @classmethod
    def holding(cls, name: str | None) -> Self:
        """Return the beliefs of an agent that knows only what is in its hand."""
        return cls() if not name else cls(Item(name), {Item(name): ItemPlace(HAND)})

    def within(self, item: Item) -> frozenset[str]:
        """Return the types of the receptacles that an object lies in, the outer ones too."""
        found: set[str] = set()
        place = self.places.get(item)
        for _ in range(_DEPTH):
            if place is None or place.beside or (kind := kind_of(place.name)) in found:
                break
            found.add(kind)
            holder = next((one for one in self.places if one.name == place.name), None)
            place = self.places[holder] if holder is not None else None
        return frozenset(found)

    def changed(self, changes: Sequence[BeliefChange]) -> Self:
        """Return the beliefs after some changes."""
        held, places, states = self.held, dict(self.places), dict(self.states)
        for item, state, place, deletes in changes:
            if place is not None:
                places.pop(item, None)
                places[item] = place
                held = item if place.name == HAND else None
            else:
                states[item] = (states.pop(item, frozenset()) - {*deletes}) | {state}
        return type(self)(held, places, states)


def apply(call: SkillCall, beliefs: BeliefState) -> BeliefState:
    """Return what is believed after a call that succeeded.

    >>> taken = apply(SkillCall.of("PickupObject", "Mug"), BeliefState())
    >>> taken.held, apply(SkillCall.of("PutObject", "Mug", "Sink"), taken).held
    (Item(name='Mug', turn=0), None)
    """
    return beliefs.changed(changes(call, beliefs))


def outcome(calls: Iterable[SkillCall], beliefs: BeliefState) -> BeliefState:
    """Return what is believed after calls that all succeeded."""
    for call in calls:
        beliefs = apply(call, beliefs)
    return beliefs


def changes(call: SkillCall, beliefs: BeliefState) -> tuple[BeliefChange, ...]:
    """Return what a call changes if it succeeds: its own effects, then side effects."""
    effect = SKILL_EFFECTS[call.skill]
    item, target = Item(call.objects[0], call.turn), call.objects[-1]
    if effect.moves:
        given = call.objects[1:] or effect.moves in ("hand", "floor")
        moved = item if given else beliefs.held
        name = {"hand": HAND, "floor": FLOOR}.get(effect.moves, target)
        place = ItemPlace(name, beside=effect.moves == "beside")
        return (BeliefChange(moved, place=place),) if moved is not None else ()
    own = tuple(BeliefChange(item, state, deletes=effect.deletes) for state in effect.adds)
    return (*own, *(two for one in own for two in _side_effects(one, beliefs)))


def _side_effects(change: BeliefChange, beliefs: BeliefState) -> Iterator[BeliefChange]:
    kind = kind_of(change.item.name)
    for effect in SIDE_EFFECTS:
        if effect.state != change.state or kind not in effect.of:
            continue
        for item in beliefs.places:
            if _reaches(effect, item, beliefs):
                for state in effect.adds:
                    yield BeliefChange(item, state, deletes=effect.deletes)


def _reaches(effect: SideEffect, item: Item, beliefs: BeliefState) -> bool:
    if effect.within.isdisjoint(beliefs.within(item)):
        return False
    kind = short_type(type_of(item.name))
    is_cut = not _IN_PIECES.isdisjoint(beliefs.states.get(item, ()))
    return effect.to is None or (piece_type(kind) if is_cut else kind) in effect.to


def unmet(call: SkillCall, beliefs: BeliefState) -> tuple[Need, ...]:
    """Return the preconditions of a call that beliefs contradict; what is unknown is no obstacle.

    The hand is always known.
    """
    return tuple(
        need for need in SKILL_EFFECTS[call.skill].needs if not _is_met(need, call, beliefs)
    )


def _is_met(need: Need, call: SkillCall, beliefs: BeliefState) -> bool:
    held, name = beliefs.held, call.objects[-1]
    states = beliefs.states.get(Item(name, call.turn), frozenset())
    match need:
        case "empty hand":
            return held is None or held.name == name
        case "held":
            return held is not None and (call.objects[0] == held.name or not call.objects[1:])
        case "not held":
            return held is None or held.name != name
        case "knife":
            return held is not None and kind_of(held.name) in KNIVES
        case "opened":
            kind = object_types().get(kind_of(name))
            return not (kind is not None and kind.must_be_open and "closed" in states)
        case "closed":
            return not (kind_of(name) in _CLOSED_TO_RUN and "opened" in states)
        case "off":
            return "on" not in states
