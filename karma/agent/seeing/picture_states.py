"""States of objects out of pictures: each is looked at on the last frame that had it in view.

Pictures that were asked about are kept as PNG files in the run folder, named by their content.
"""

import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from karma.agent.seeing.projection import placed
from karma.files import inside, write_atomic
from karma.types.observation import Observation, SeenObject
from karma.types.roles import VisionModel
from karma.types.space import Frame

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
    if not (path := inside(folder, name)).exists():
        write_atomic(path, data)
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
