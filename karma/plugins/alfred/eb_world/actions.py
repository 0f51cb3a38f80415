"""What EB-ALFRED and its ancestor, LoTa-Bench's ALFRED, let a planner do in the same rooms.

Planners choose from a list of actions: EB-ALFRED's by numbers, LoTa-Bench's by words.

Of EB-ALFRED, first come the same actions in every room, from the benchmark's lists of types. Then,
where a room has several of a type, its second, third ... get actions of their own: `find a
Cabinet_2`. The bare name is the first one's for find, open and close; other verbs name a type.

The order of a room's objects is Unity's in the source and our world's here, so which cabinet is
`Cabinet_2` is not the same cabinet.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from karma.files import read_json
from karma.household.ids import root_id, root_type, type_of
from karma.household.pieces import is_piece
from karma.household.types import in_words
from karma.household.uses import BURNER
from karma.world.core.rules import rules

Verb = Literal[
    "find", "pick up", "put", "drop", "open", "close", "turn on", "turn off", "slice", "done",
]  # fmt: skip
Thing = Mapping[str, Any]  # one object of the metadata
PUT, DROP = "put down the object in hand", "drop the object in hand"
DONE = "done"
_ONE = ("find", "open", "close")  # verbs whose bare name means the first of a type
_AS_IT_STANDS = ("CD",)  # in LoTa-Bench


class ActionTypes(msgspec.Struct, frozen=True, kw_only=True, rename=lambda name: f"alfred_{name}"):
    """The benchmark's lists of types, whose order is that of the numbers."""

    objs: tuple[str, ...]
    pick_obj: tuple[str, ...]
    open_obj: tuple[str, ...]
    toggle_obj: tuple[str, ...]
    slice_obj: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomProtocol:
    """A benchmark's limits, and what its robot does with a body that is the same."""

    most_steps: int
    most_invalid: int | None  # None = any number
    stops_at_goal: bool  # else the goal is looked at when the planner is done
    goes_on: bool  # with a plan of which an action failed
    numbered: bool  # second and further things of a type have actions of their own
    stays_within_m: float  # what is in view and nearer than this is found without a step
    basin_first: bool  # a put tries a basin first, else what is nearer of it and its sink
    patience: int  # failed puts at a target, from which on one lets go
    drop_counts: bool  # letting go is done well, else it is a put that failed


EB_ALFRED = RoomProtocol(
    most_steps=30, most_invalid=10, stops_at_goal=True, goes_on=False, numbered=True,
    stays_within_m=0.0, basin_first=True, patience=3, drop_counts=True,
)  # fmt: skip
LOTA_ALFRED = RoomProtocol(
    most_steps=25, most_invalid=None, stops_at_goal=False, goes_on=True, numbered=False,
    stays_within_m=1.0, basin_first=False, patience=1, drop_counts=False,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberedAction:
    """One entry of the list."""

    verb: Verb
    noun: str = ""  # a type, or one of several: "Cabinet_2"
    object_id: str = ""  # where it means one object and no other
    written: str = ""  # how, where not as EB-ALFRED writes it

    def __str__(self) -> str:
        """Return how it is written in the list."""
        if self.written:
            return self.written
        if self.verb == "put":
            return PUT
        if self.verb == "drop":
            return DROP
        return f"{self.verb} {'a' if self.verb == 'find' else 'the'} {self.noun}"


def read_types(path: Path) -> ActionTypes:
    """Read the lists of types.

    Raises:
        FileError: missing, torn or of another form.
    """
    return read_json(path, ActionTypes, fix="give EB-ALFRED's lists of types as JSON")


def actions_in(types: ActionTypes, things: Sequence[Thing]) -> tuple[NumberedAction, ...]:
    """Return all actions of a room; the number of each is its place.

    Args:
        types: of the benchmark.
        things: all objects at the start, in the order of the metadata.
    """
    receptacles = _several(one for one in things if one["receptacle"])
    others = _several(one for one in things if one["pickupable"] and not one["receptacle"])
    first = {kind: ids[0] for kind, ids in {**receptacles, **others}.items()}
    fixed = [
        NumberedAction(verb=verb, noun=kind, object_id=first.get(kind, "") if verb in _ONE else "")
        for verb, kind in _listed(types, _EVERYWHERE)
    ]
    return (*fixed, *_more(types, receptacles, others))


def names_in(actions: Iterable[NumberedAction]) -> dict[str, str]:
    """Return by object id what a room's several instances are called."""
    return {one.object_id: one.noun for one in actions if one.verb == "find" and one.object_id}


_Row = tuple[tuple[Verb, ...], str]  # verbs, and the field of the types they are for, in turn
_EVERYWHERE: tuple[_Row, ...] = (
    (("find",), "objs"),
    (("pick up",), "pick_obj"),
    (("put", "drop"), ""),
    (("open", "close"), "open_obj"),
    (("turn on", "turn off"), "toggle_obj"),
    (("slice",), "slice_obj"),
)
_SKILLS: tuple[_Row, ...] = (
    (("find",), "objs"),
    (("pick up", "put"), "pick_obj"),
    (("open", "close"), "open_obj"),
    (("slice",), "slice_obj"),
    (("turn on", "turn off"), "toggle_obj"),
)


def _listed(types: ActionTypes, rows: Iterable[_Row]) -> Iterator[tuple[Verb, str]]:
    """Yield the verbs and types of a list in its order."""
    for verbs, field in rows:
        for kind in getattr(types, field) if field else ("",):
            for verb in verbs:
                yield verb, kind


def _several(things: Iterable[Thing]) -> dict[str, list[str]]:
    """Return the types that there are several of, with their ids; ids keep ALFRED's words."""
    found: dict[str, list[str]] = {}
    for one in things:
        found.setdefault(type_of(one["objectId"]), []).append(one["objectId"])
    return {kind: ids for kind, ids in found.items() if len(ids) > 1}


def _more(
    types: ActionTypes, receptacles: Mapping[str, list[str]], others: Mapping[str, list[str]]
) -> Iterator[NumberedAction]:
    places, loose = _suffixed(receptacles), _suffixed(others)
    for noun, one in places:
        yield NumberedAction(verb="find", noun=noun, object_id=one)
    for noun, one in places:
        if type_of(one) in types.open_obj:
            yield NumberedAction(verb="open", noun=noun, object_id=one)
            yield NumberedAction(verb="close", noun=noun, object_id=one)
    for noun, one in loose:
        if type_of(one) in types.pick_obj:
            yield NumberedAction(verb="find", noun=noun, object_id=one)


def _suffixed(groups: Mapping[str, list[str]]) -> list[tuple[str, str]]:
    return sorted(
        (f"{kind}_{number}", one)
        for kind, ids in groups.items()
        for number, one in enumerate(ids[1:], start=2)
    )


# ----------------------------------------------------------------- LoTa-Bench's skills


def skills_of(types: ActionTypes) -> tuple[NumberedAction, ...]:
    """Return LoTa-Bench's 214 skills in natural words, the same in every room.

    The source lists what can be found in the order of a Python set, another in every process; here
    it is that of EB-ALFRED's numbers. `put down` names a thing, but it is what is held that goes.
    """
    skills = (_skill(verb, kind) for verb, kind in _listed(types, _SKILLS))
    return (NumberedAction(verb="done", written=DONE), *skills)


def _skill(verb: Verb, kind: str) -> NumberedAction:
    words = kind if kind in _AS_IT_STANDS else in_words(kind)
    article = "the" if verb != "find" else "an" if words[0] in "aeiou" else "a"
    phrase = "put down" if verb == "put" else verb
    return NumberedAction(verb=verb, noun=kind, written=f"{phrase} {article} {words}")


# ----------------------------------------------------------------- which object a name means

_SHUT_IN, _IN_USE, _UNSEEN, _PIECE = 100_000.0, 10_000.0, 1_000.0, -100.0  # metres more


def nearest(
    things: Sequence[Thing],
    word: str,
    *,
    able: str = "",
    by_sight: bool = False,
    pieces_first: bool = False,
    parts_only: bool = False,
    any_lid: bool = False,
    other_than: str = "",
) -> Thing | None:
    """Return the object of a type with the least distance and penalties; None if there is none.

    Pieces count as the whole that they were cut from, basins as their sink or bathtub. The object
    has to have the flag `able` ("pickupable"). With `by_sight` what is out of view comes later,
    with `parts_only` only basins and pieces count, with `any_lid` a toilet's lid shuts in, too,
    what lies on top of it.
    """
    shut = {
        one["objectId"]
        for one in things
        if one["openable"] and not one["isOpen"] and (any_lid or hides(one["objectType"]))
    }
    found = []
    for number, one in enumerate(things):
        object_id = one["objectId"]
        if root_type(object_id) != word or object_id == other_than or (able and not one[able]):
            continue
        if parts_only and root_id(object_id) == object_id:
            continue
        cost = float(one["distance"])
        cost += _SHUT_IN if not shut.isdisjoint(one["parentReceptacles"] or ()) else 0.0
        cost += _IN_USE if word == BURNER and one["receptacleObjectIds"] else 0.0
        cost += _UNSEEN if by_sight and not one["visible"] else 0.0
        cost += _PIECE if pieces_first and is_piece(type_of(object_id)) else 0.0
        found.append((cost, number))
    return things[min(found)[1]] if found else None


def hides(kind: str) -> bool:
    """Return whether what is in such a thing cannot be seen while it is shut."""
    return kind in rules().view.hides_when_closed


def by_id(things: Sequence[Thing], object_id: str) -> Thing | None:
    """Return the object of an id; None if there is none."""
    return next((one for one in things if one["objectId"] == object_id), None)
