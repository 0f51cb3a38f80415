"""What questions are answered from: what was seen, when, and what a person told of it."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from karma.agent.seeing.perceive import place_of
from karma.assistant.replies import MemoryAnswer
from karma.assistant.session_log import PLACE_TOLD, TOLD, PastRequest
from karma.household.ids import root_id, type_of
from karma.household.pieces import base_type, is_piece
from karma.household.uses import HAVE_PARTS, PARTS_OF_FURNITURE, without_basin
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.object_finder import is_below
from karma.plugins.rules.types import Mention
from karma.types.memory import MemoryUnit
from karma.types.observation import SeenObject

T = TypeVar("T")
Sight = tuple[SeenObject, float]  # of a thing, and when it was in view
MOST = 6  # things or errands in one answer
_OLD_S = 3600.0  # what was seen so long ago may have been moved


def answer(*lines: str, known: bool = True, look: str = "") -> MemoryAnswer:
    """Return an answer of these lines."""
    return MemoryAnswer(lines=lines, known=known, look=look)


def unknown(line: str, *, look: str = "") -> MemoryAnswer:
    """Return an answer that says what is not known."""
    return answer(line, known=False, look=look)


def few(things: Sequence[T], said: Callable[[T], str]) -> str:
    """Return what is said of the first of some things, and how many more there are."""
    more = f" and {len(things) - MOST} more" if len(things) > MOST else ""
    return ", ".join(map(said, things[:MOST])) + more


def last_first(sights: Iterable[Sight]) -> list[Sight]:
    """Return sights, the last seen first."""
    return sorted(sights, key=lambda one: (-one[1], one[0].object_id))


def _unknown_chance(sight: SeenObject, seen_s: float) -> None:
    """Return that nothing is known of how long objects stay where they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembering:
    """What questions are answered from."""

    sights: Mapping[str, Sight]  # id -> the latest
    units: Mapping[str, MemoryUnit]  # short-term memory
    furniture: Sequence[str]  # types on the map
    past: Sequence[PastRequest]
    now_s: float
    chance_in_place: Callable[[SeenObject, float], float | None] = _unknown_chance

    def of(self, thing: Mention) -> list[Sight]:
        """Return the sights of what a mention may mean, the last seen first."""
        found = reversed(self._others(thing) if thing.other else self._called(thing))
        return list({_heap(sight): (sight, when) for sight, when in found}.values())[::-1]

    def _others(self, thing: Mention) -> list[Sight]:
        """Return the sights of "the other mug": of those that were not handled last."""
        found = self._called(thing)
        handled = [name for name, unit in self.units.items() if unit.handled]
        last = next((n for n in reversed(handled) if any(n == s.object_id for s, _ in found)), None)
        return [one for one in found if one[0].object_id != last]

    def pieces_of(self, thing: Mention) -> list[Sight]:
        """Return the sights of each piece of what a mention may mean, the last seen first."""
        return [one for one in self._called(thing) if is_piece(one[0].object_type)]

    def _called(self, thing: Mention) -> list[Sight]:
        kinds = {*thing.types, *map(without_basin, thing.types)}
        pieces = thing.text.split()[-1] in request_words().pieces  # "where are the slices?"
        return last_first(
            one for one in self.all()
            if kinds & {one[0].object_type, base_type(one[0].object_type)}
            and (not pieces or is_piece(one[0].object_type))
            and (not _is_of_furniture(thing) or self._is_part_of(one[0], thing.at))
        )  # fmt: skip

    def _is_part_of(self, sight: SeenObject, kinds: Collection[str]) -> bool:
        """Return whether a drawer is one of some furniture: of the desk."""
        return any(one.object_type in kinds and is_below(sight, one) for one, _ in self.all())

    def whole_of(self, sight: SeenObject) -> str | None:
        """Return the id of the furniture that a drawer is one of, None where none was seen."""
        if sight.object_type not in PARTS_OF_FURNITURE:
            return None
        wholes = (one for one, _ in self.all() if one.object_type in HAVE_PARTS)
        return next((one.object_id for one in wholes if is_below(sight, one)), None)

    def lies_at(self, sight: SeenObject, places: Sequence[Mention]) -> bool:
        """Return whether a thing lies in or on one of some places; of none it always does."""
        whole = (one for one in places if not _is_of_furniture(one))
        kinds = {without_basin(kind) for place in whole for kind in place.types}
        parts = (self.of(one) for one in places if _is_of_furniture(one))
        ids = {one.object_id for found in parts for one, _ in found}
        return not places or any(
            one in ids or without_basin(type_of(one)) in kinds for one in sight.parent_ids
        )

    def all(self) -> Iterator[Sight]:
        """Yield each thing that was seen, in the states that are known, with when it was seen."""
        for sight, when in self.sights.values():
            yield replace(sight, states=self._states(sight)), when

    def _states(self, sight: SeenObject) -> tuple[str, ...]:
        unit = self.units.get(sight.object_id)
        return tuple(dict.fromkeys((*sight.states, *(unit.states if unit else ()))))

    def ago(self, when_s: float) -> str:
        """Return how long ago something was."""
        return age(self.now_s - when_s)

    def is_old(self, when_s: float) -> bool:
        """Return whether what was seen then may be otherwise by now."""
        return self.now_s - when_s > _OLD_S

    def seen(self, sight: SeenObject, when_s: float, about: str = PLACE_TOLD) -> str:
        """Return when a thing was seen or told of, and whether that may not be so any more."""
        told_s = self._told_s(sight.object_id, about)
        how = f"you told me {self.ago(told_s)}" if told_s >= when_s else f"seen {self.ago(when_s)}"
        if not self.is_old(max(told_s, when_s)):
            return how
        sure = self.chance_in_place(sight, max(told_s, when_s)) if sight.pickupable else None
        if sure is not None:
            return f"{how}; people live here: {sure:.1f} is the chance that it is still there"
        return f"{how}; that may have changed since"

    def told(self) -> set[str]:
        """Return the ids of which a person told where or how they are after they were seen."""
        return {
            name for name, (_, when_s) in self.sights.items()
            if max(self._told_s(name, about) for about in TOLD) >= when_s
        }  # fmt: skip

    def _told_s(self, object_id: str, about: str) -> float:
        """Return when a person last told that of a thing; before all time if nobody did."""
        told = (
            one.at_s
            for one in self.past
            if one.status == about
            and any(object_id == s.object_id for change in one.changes for s in change.seen)
        )
        return max(told, default=-1.0)


def _is_of_furniture(thing: Mention) -> bool:
    """Return whether a part of furniture is told by what it is of: "the desk drawer"."""
    return bool(thing.at and thing.types) and PARTS_OF_FURNITURE.issuperset(thing.types)


def _heap(sight: SeenObject) -> tuple[str, str | None]:
    """Return what stands for a thing: the pieces of one whole at one place are one."""
    name, piece = sight.object_id, is_piece(sight.object_type)
    return (root_id(name) if piece else name), (place_of(sight) if piece else None)


def age(seconds: float) -> str:
    """Return a time that has passed, in words.

    >>> age(5), age(200), age(7300), age(200_000)
    ('just now', '3 minutes ago', '2 hours ago', '2 days ago')
    """
    for size, unit in ((86_400, "day"), (3600, "hour"), (60, "minute")):
        if (count := int(seconds // size)) > 0:
            return f"{count} {unit}{'s' * (count > 1)} ago"
    return "just now"
