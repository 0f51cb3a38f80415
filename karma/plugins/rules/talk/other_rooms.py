"""What is said of another room: answered from the memory of a home there, never done in this one.

A home is one room. Another is known only where the same person keeps a home there; its log is read,
and nothing of it is changed.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from karma.contracts import MemoryUnit, SceneRef, SeenObject
from karma.household.places import ROOMS
from karma.household.types import object_types
from karma.memory.scene_graph import SceneGraph
from karma.plugins.homes.home import HomeStory, homes, left_s, read_home
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.talk.questions import answered
from karma.plugins.rules.talk.remembering import MemoryAnswer, Remembering, age, answer
from karma.plugins.rules.talk.views import RoomMap
from karma.plugins.rules.types import Request

_IN_WORDS = {"living": "living room"}
_PARTS = re.compile(r"[,;:.]|\b(?:so|because|as|and)\b", re.IGNORECASE)  # of a sentence
_OTHER = "other"  # of `room_names`: of whatever kind, but not this one


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomSaid:
    """A room that words name."""

    name: str  # as it was said: "the bedroom"
    kind: str  # of `room_names` in `karma/plugins/rules/language/request_words.toml`
    is_here: bool
    text: str  # all that was said, with "here" in its place


def room_said(request: Request, scene: str) -> RoomSaid | None:
    """Return the room that a request names as a place, or by a place's name: "the bathroom sink".

    None where it names none, or nobody knows what kind of room this one is.
    """
    own, text = room_kind(scene), request.text
    named = [*request.alone, *request.mentions]
    if not own or (request.form != "question" and _is_negated(text)):
        return None
    for found in _in_a_room().finditer(text):
        kind = _kinds()[found["room"].lower()]
        compound = any(one.text.lower().startswith(f"{found['room'].lower()} ") for one in named)
        if not compound and (request.form != "errand" or _is_of_a_deed(found, request)):
            is_here = kind == own and not found["which"]
            name = f"{found['det'] or ''}{found['which'] or ''}{found['room']}".strip()
            here = f"{text[: found.start()]}here{text[found.end() :]}"
            return RoomSaid(name=name, kind=kind, is_here=is_here, text=here)
    for one in named:
        kind = next((k for k in ROOMS if one.text.lower().startswith(f"{_called(k)} ")), own)
        carried = any(object_types()[each].can("pickupable") for each in one.types)
        if kind != own and one.types and not carried:
            name = f"the {_called(kind)}"
            here = re.sub(rf"\b{_called(kind)} ", "", text, flags=re.IGNORECASE)
            return RoomSaid(name=name, kind=kind, is_here=False, text=here)
    return None


def of_room(
    room: RoomSaid, asked: Request, scene: str, here: Path | None, reader: RequestReader
) -> MemoryAnswer:
    """Return what is said of another room than `scene`, by somebody whose home is kept in `here`.

    Raises:
        FileError: the other home is damaged.
    """
    only = f"This home is only a {_called(room_kind(scene))}"
    there = list(_homes_of(room, scene, here))
    if asked.form != "question":
        told = asked.form in ("statement", "teaching")
        what = f"keep nothing of {room.name} here" if told else f"can do nothing in {room.name}"
        line = f"{only}: I {what}."
        more = f" Tell me there: karma chat --home {there[0][0].name}." if there else ""
        return MemoryAnswer(lines=(line + more,), known=False, refuses=not told)
    question, lines = replace(asked, text=room.text), list[str]()
    for folder, home in there:
        found = answered(question, _remembering(folder, home), reader)
        if found is not None:
            left = f"In the home {folder.name} ({_scene(home)}), left {age(left_s(folder))}:"
            if found.known:
                return replace(found, lines=(left, *found.lines))
            lines += [left, *found.lines]
    return answer(*(lines or [f"{only}: I know nothing of {room.name}."]), known=False)


def room_kind(scene: str) -> str:
    """Return what kind of room a scene is by its name; "" where that does not say it.

    >>> room_kind("kitchen_1"), room_kind("FloorPlan212"), room_kind("loft")
    ('kitchen', 'living', '')
    """
    from karma.plugins.thor_tools.importing.scenes import ROOMS as THEIRS
    from karma.plugins.thor_tools.importing.scenes import room_by_name

    named, theirs = scene.partition("_")[0], room_by_name(scene)
    if named in ROOMS:
        return named
    return ROOMS[THEIRS.index(theirs)] if theirs is not None else ""


# ----------------------------------------------------------------- parts


@cache
def _kinds() -> dict[str, str]:
    return {name: kind for kind, names in request_words().room_names.items() for name in names}


@cache
def _in_a_room() -> re.Pattern[str]:
    names = "|".join(sorted(_kinds(), key=len, reverse=True))
    return re.compile(
        r"\b(?:in|into|inside|to|from|at|of)\s+(?P<det>(?:the|my|our|your|his|her|their|a)\s+)?"
        rf"(?P<which>(?:other|another|second|next|guest|spare|master)\s+)?(?P<room>{names})\b",
        re.IGNORECASE,
    )


def _called(kind: str) -> str:
    return _IN_WORDS.get(kind, kind)


def _is_negated(text: str) -> bool:
    words = text.lower().replace("n't", " n't").split()
    return not request_words().negations.isdisjoint(words)


def _is_of_a_deed(found: re.Match[str], errand: Request) -> bool:
    """Return whether a room is said of what is to be done, not beside it: "I am in the hall"."""
    before = [one.end() for one in _PARTS.finditer(found.string, 0, found.start())]
    begins = before[-1] if before else 0
    ends = _PARTS.search(found.string, found.end())
    span = range(begins, ends.start() if ends else len(found.string))
    offset = max(errand.whole.find(found.string), 0)
    starts = (*(deed.start for deed in errand.deeds), *(one.start for one in errand.mentions))
    return any(start - offset in span for start in starts)


def _homes_of(room: RoomSaid, scene: str, here: Path | None) -> Iterator[tuple[Path, HomeStory]]:
    """Yield the other homes in such a room, the one left last first."""
    own = None if here is None else here.resolve()
    found = [(folder, read_home(folder)) for folder in homes() if folder.resolve() != own]
    for folder, home in sorted(found, key=lambda one: left_s(one[0])):
        kind = room_kind(_scene(home))
        if kind == room.kind or (room.kind == _OTHER and kind != room_kind(scene)):
            yield folder, home


def _scene(home: HomeStory) -> str:
    return SceneRef.of(home.card.scene).name


def _remembering(folder: Path, home: HomeStory) -> Remembering:
    """Return what questions about a home are answered from, as its log has it."""
    sights: dict[str, SeenObject] = {}
    when: dict[str, float] = {}
    units: dict[str, MemoryUnit] = {}
    for change in (change for errand in home.past for change in errand.changes):
        sights |= {one.object_id: one for one in change.seen}
        when |= dict.fromkeys(change.in_view, change.at_s)
        units |= {one.object_id: one for one in (*change.corrected, *change.remembered)}
        for gone in (*change.gone, *change.forgotten):
            sights.pop(gone, None)
            units.pop(gone, None)
    path = folder / "maps" / f"{_scene(home)}.json"
    return Remembering(
        sights={name: (one, when.get(name, 0.0)) for name, one in sights.items()},
        units=units,
        furniture=RoomMap.of(_scene(home), SceneGraph.load(path)).types() if path.exists() else (),
        past=home.past,
        now_s=home.clock_s + left_s(folder),
        people=home.card.people,
        is_here=False,
    )
