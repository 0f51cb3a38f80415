"""From what the skills saw and did to units of short-term memory; their states out of pictures.

Each object is looked at on the last frame in which the agent had it in view. Pictures that were
asked about are kept as PNG files in the run folder, named by their content.
"""

import hashlib
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from karma.agent.seeing.perceive import place_of
from karma.agent.seeing.projection import placed
from karma.contracts import Experience, Frame, MemoryUnit, Observation, SeenObject, VisionModel
from karma.files import write_atomic
from karma.household.ids import is_part, type_of, whole_id
from karma.household.places import STAND_CLOSED
from karma.memory.short_term import merged


def units_of(
    experience: Experience,
    before: Sequence[MemoryUnit],
    vision: VisionModel,
    instruction: str,
    *,
    scene: str,
    seen_kept: int,
    folder: Path | None = None,
) -> list[MemoryUnit]:
    """Return what to remember: things only seen first, then things handled, in order of use.

    Only what can be carried; immovable things belong to long-term memory. A thing that was cut is
    represented by one slice, the one handled last, which inherits the history of the whole.

    `before` are units whose history goes on in these. Of what was only seen the last `seen_kept`
    things are kept; `folder` takes the pictures that were looked at.
    """
    handled = _handled(experience)
    others = _only_seen(experience, handled)
    kept = others[len(others) - seen_kept :] if seen_kept else []
    sights = [*kept, *(experience.seen[object_id] for object_id in handled)]
    looked = look_at(vision, instruction, sights, experience.views, folder)
    by_id = {unit.object_id: unit for unit in before}
    found = []
    for sight in sights:
        name = sight.object_id
        states = (*experience.effects.get(name, ()), *looked.states.get(name, ()))
        image = looked.images.get(name)
        unit = unit_of(sight, states, handled=name in handled, image=image, scene=scene)
        whole = whole_id(name) if whole_id(name) in experience.cut else ""
        old = by_id.get(name) or by_id.get(whole)
        found.append(merged(old, unit) if old is not None else unit)
    return found


def shut_away(units: Iterable[MemoryUnit], among: Iterable[MemoryUnit]) -> tuple[MemoryUnit, ...]:
    """Return units as they are told: what lies in a thing behind a door lies behind that door.

    `among` is what is remembered of the room.
    """
    places = {unit.object_id: unit.place_id for unit in among}
    found = []
    for unit in units:
        place, passed = unit.place_id, set[str]()
        while place is not None and place not in passed and type_of(place) not in STAND_CLOSED:
            passed.add(place)
            place = places.get(place)
        door = place if place is not None and place not in passed else unit.place_id
        found.append(replace(unit, place_id=door))
    return tuple(found)


def unit_of(
    sight: SeenObject, states: Sequence[str], *, handled: bool, image: str | None, scene: str = ""
) -> MemoryUnit:
    """Return the line of short-term memory for one sight of an object.

    `states` are in the order they came about, "none" is dropped; `image` is a path below the run
    folder.
    """
    return MemoryUnit(
        object_id=sight.object_id,
        object_type=sight.object_type,
        position_m=sight.position_m,
        states=tuple(dict.fromkeys(word for word in states if word != "none")),
        place_id=place_of(sight),
        handled=handled,
        image=image,
        scene=scene,
    )


def _only_seen(experience: Experience, handled: Sequence[str]) -> list[SeenObject]:
    """Return the sights of what can be carried and was not handled, nor cut off a whole."""
    return [
        sight
        for object_id, sight in experience.seen.items()
        if sight.pickupable and object_id not in handled and object_id not in experience.cut
        if not any(is_part(object_id, whole) for whole in experience.cut)
    ]


def _handled(experience: Experience) -> list[str]:
    """Return the ids that stand for what was handled, by last use."""
    last: dict[str, None] = {}
    for object_id in experience.handled_ids:
        name = _standing_for(object_id, experience, last)
        sight = experience.seen.get(name)
        if sight is not None and sight.pickupable:
            last.pop(name, None)
            last[name] = None
    return list(last)


def _standing_for(object_id: str, experience: Experience, before: Iterable[str]) -> str:
    """Return the id itself, or the slice that stands for a whole that was cut."""
    if object_id not in experience.cut:
        return object_id
    parts = [name for name in experience.seen if is_part(name, object_id)]
    used = [name for name in before if name in parts]
    return (used or sorted(parts) or [object_id])[-1]


# ----------------------------------------------------------------- states out of pictures

PICTURES = "short_term/images"  # below the run folder, as Listing 1 has it


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """What pictures told of some objects."""

    states: Mapping[str, tuple[str, ...]]  # object id -> words
    images: Mapping[str, str]  # object id -> path below the run folder


def look_at(
    vision: VisionModel,
    instruction: str,
    sights: Sequence[SeenObject],
    views: Mapping[str, Observation],
    folder: Path | None,
) -> Looked:
    """Ask a vision model about the last picture of each sight, one question per picture.

    A model that needs no pictures is asked without. `views` are those in which each id was last in
    view; ids without one are not asked about. Without `folder`, the run's, no pictures are kept.
    """
    if not vision.needs_pictures:
        return Looked(states=vision.read_states(None, instruction, sights), images={})
    states: dict[str, tuple[str, ...]] = {}
    images: dict[str, str] = {}
    for view, group in _by_view(sights, views):
        frame = view.render()
        if frame is None:
            continue
        states.update(vision.read_states(frame, instruction, _placed(group, view)))
        if folder is not None:
            images.update(dict.fromkeys((one.object_id for one in group), keep(frame, folder)))
    return Looked(states=states, images=images)


def keep(frame: Frame, folder: Path) -> str:
    """Write a picture into the run folder, once; returns its path below it."""
    data = png(frame)
    name = f"{PICTURES}/{picture_name(data)}.png"
    if not (folder / name).exists():
        write_atomic(folder / name, data)
    return name


def picture_name(data: bytes) -> str:
    """Return what a picture is called after its content."""
    return hashlib.sha256(data).hexdigest()[:20]


def png(frame: Frame) -> bytes:
    """Return a picture as a PNG file; equal pictures give equal bytes."""
    height, width, _ = frame.shape
    rows = np.zeros((height, 1 + width * 3), dtype=np.uint8)  # each row begins with its filter, 0
    rows[:, 1:] = frame.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    chunks = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _by_view(
    sights: Sequence[SeenObject], views: Mapping[str, Observation]
) -> list[tuple[Observation, list[SeenObject]]]:
    """Return the sights grouped by where they were last in view, in the order of the sights."""
    groups: dict[int, tuple[Observation, list[SeenObject]]] = {}
    for sight in sights:
        if view := views.get(sight.object_id):
            groups.setdefault(id(view), (view, []))[1].append(sight)
    return list(groups.values())


def _placed(group: Sequence[SeenObject], view: Observation) -> list[SeenObject]:
    """Return sights with their place in the view's frame and without the simulator's states."""
    boxes = {sight.object_id: sight for sight in (*view.seen, *filter(None, [view.held]))}
    found = []
    for one in group:
        seen = boxes[one.object_id]
        sight = replace(one, states=(), region=seen.region, silhouette=seen.silhouette)
        found.append(sight if seen.region else placed(sight, view.camera, seen))
    return found
