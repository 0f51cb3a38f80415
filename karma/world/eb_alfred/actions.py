"""Write the lists of actions that planners choose from: EB-ALFRED's by numbers, LoTa-Bench's words.

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
from karma.household.ids import type_of
from karma.household.types import in_words

Verb = Literal[
    "find", "pick up", "put", "drop", "open", "close", "turn on", "turn off", "slice", "done",
]  # fmt: skip
Thing = Mapping[str, Any]  # one object of the metadata
PUT, DROP = "put down the object in hand", "drop the object in hand"
DONE = "done"
_AS_IT_STANDS = ("CD",)  # in LoTa-Bench


class ActionTypes(msgspec.Struct, frozen=True, kw_only=True, rename=lambda name: f"alfred_{name}"):
    """The benchmark's lists of types, whose order is that of the numbers."""

    objs: tuple[str, ...]
    pick_obj: tuple[str, ...]
    open_obj: tuple[str, ...]
    toggle_obj: tuple[str, ...]
    slice_obj: tuple[str, ...]


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
    fixed = [_meant(action, first) for action in _everywhere(types)]
    return (*fixed, *_more(types, receptacles, others))


def names_in(actions: Iterable[NumberedAction]) -> dict[str, str]:
    """Return by object id what a room's several instances are called."""
    return {one.object_id: one.noun for one in actions if one.verb == "find" and one.object_id}


def _everywhere(types: ActionTypes) -> Iterator[NumberedAction]:
    yield from (NumberedAction(verb="find", noun=kind) for kind in types.objs)
    yield from (NumberedAction(verb="pick up", noun=kind) for kind in types.pick_obj)
    yield NumberedAction(verb="put")
    yield NumberedAction(verb="drop")
    for kind in types.open_obj:
        yield from (NumberedAction(verb="open", noun=kind), NumberedAction(verb="close", noun=kind))
    for kind in types.toggle_obj:
        yield from (
            NumberedAction(verb="turn on", noun=kind),
            NumberedAction(verb="turn off", noun=kind),
        )
    yield from (NumberedAction(verb="slice", noun=kind) for kind in types.slice_obj)


def _several(things: Iterable[Thing]) -> dict[str, list[str]]:
    """Return the types that there are several of, with their ids; ids keep ALFRED's words."""
    found: dict[str, list[str]] = {}
    for one in things:
        found.setdefault(type_of(one["objectId"]), []).append(one["objectId"])
    return {kind: ids for kind, ids in found.items() if len(ids) > 1}


def _meant(action: NumberedAction, first: Mapping[str, str]) -> NumberedAction:
    if action.verb in ("find", "open", "close") and action.noun in first:
        return NumberedAction(verb=action.verb, noun=action.noun, object_id=first[action.noun])
    return action


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
    return (NumberedAction(verb="done", written=DONE), *_skills(types))


def _skills(types: ActionTypes) -> Iterator[NumberedAction]:
    yield from _of("find", types.objs)
    for kind in types.pick_obj:
        yield from (_skill("pick up", kind), _skill("put", kind))
    for kind in types.open_obj:
        yield from (_skill("open", kind), _skill("close", kind))
    yield from _of("slice", types.slice_obj)
    for kind in types.toggle_obj:
        yield from (_skill("turn on", kind), _skill("turn off", kind))


def _of(verb: Verb, kinds: Sequence[str]) -> Iterator[NumberedAction]:
    yield from (_skill(verb, kind) for kind in kinds)


def _skill(verb: Verb, kind: str) -> NumberedAction:
    words = kind if kind in _AS_IT_STANDS else in_words(kind)
    article = "the" if verb != "find" else "an" if words[0] in "aeiou" else "a"
    said = "put down" if verb == "put" else verb
    return NumberedAction(verb=verb, noun=kind, written=f"{said} {article} {words}")
