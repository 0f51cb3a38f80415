"""What a person tells the agent: where a thing is. It is believed until eyes say otherwise."""

from dataclasses import dataclass, replace

from karma.agent.perceive import place_of
from karma.contracts import MemoryChange, Mention, Request, SeenObject
from karma.household.places import HAND
from karma.household.saying import name_of, told_place
from karma.language.request import RequestReader
from karma.language.request_words import request_words
from karma.methods.experience import unit_of
from karma.talk.history import can_lie_in, habit_in, is_owning
from karma.talk.questions import MemoryAnswer, Remembering, is_at

_NOT_NOW = frozenset(
    ("no", "was", "were", "used", "should", "belongs", "belong", "goes", "go", "will", "or",
     "maybe", "if")
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ToldPlace:
    """Where a thing is, by a person's words, and what that leaves in memory."""

    answer: MemoryAnswer
    change: MemoryChange | None  # None: eyes know better


def told_of(
    request: Request, knows: Remembering, scene: str, reader: RequestReader | None = None
) -> ToldPlace | None:
    """Return what a statement says of a thing's place, whose it is or where it always goes.

    None where it says no such thing.

    Of a thing that was seen the believed place moves there, if one such place is known.

    Args:
        request: whose form is "statement" or "teaching".
        knows: what is remembered.
        scene: name of the room.
        reader: of English.
    """
    change = MemoryChange(scene=scene, at_s=knows.now_s)
    habit = habit_in(request.text, reader) if reader is not None else None
    if habit is not None:
        usual = f"the {name_of(habit[0][0])} goes {told_place(habit[1])}"
        return ToldPlace(answer=MemoryAnswer(lines=(f"I will remember: {usual}.",)), change=change)
    thing, place = _thing_and_place(request)
    if thing is None or place is None:
        return None
    found, places = knows.of(thing), knows.of(place)
    name, where = name_of(thing.types[0]), told_place(place.types[0])
    if found and place_of(found[0][0]) == HAND:
        held = MemoryAnswer(lines=(f"I have the {name} in my hand.",))
        return ToldPlace(answer=held, change=None)
    own = [one for one, _ in found if is_at(one, [place])] if is_owning(request.text) else []
    if len(own) == 1:
        where = told_place(place_of(own[0]))
        mine = MemoryAnswer(lines=(f"I will remember: the {name} {where} is yours.",))
        return ToldPlace(answer=mine, change=replace(change, seen=(own[0],)))
    if own:
        some = MemoryAnswer(lines=(f"I have seen {len(own)} {where}: which of them is yours?",))
        return ToldPlace(answer=replace(some, known=False), change=None)
    if found and len(places) == 1:
        sight, there = found[0][0], places[0][0]
        moved = _moved(sight, there)
        line = unit_of(moved, (), handled=False, image=None, scene=scene)
        change = replace(change, seen=(moved,), remembered=(line,))
    return ToldPlace(
        answer=MemoryAnswer(lines=(f"I will remember: the {name} is {where}.",)), change=change
    )


def _thing_and_place(request: Request) -> tuple[Mention | None, Mention | None]:
    words = request.text.lower().replace("n't", " n't").split()
    named = [one for one in request.alone if one.types]
    lists = request_words()
    otherwise = _NOT_NOW | lists.habits | lists.negations
    if len(named) != 2 or otherwise & {word.strip(".,!") for word in words}:
        return None, None
    thing, place = named
    return (thing, place) if can_lie_in(thing, place) else (None, None)


def _moved(sight: SeenObject, there: SeenObject) -> SeenObject:
    return replace(
        sight,
        parent_ids=(there.object_id,),
        position_m=there.position_m,
        box_center_m=there.box_center_m,
        region=None,
        silhouette=(),
    )
