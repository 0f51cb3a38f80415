"""Give each object, each type and the room's structure a colour, as AI2-THOR's tables do."""

from collections.abc import Mapping
from functools import lru_cache
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.world.core.scene import SceneObject
from karma.world.render.mesh import packed
from karma.world.render.pixels import AGENT, CEILING, FLOOR, NOTHING, PIECES, STAND, WALL

RGB = tuple[int, int, int]
STRUCTURE: Mapping[int, str] = {
    NOTHING: "Sky",
    WALL: "Wall",
    CEILING: "Ceiling",
    FLOOR: "Floor",
    PIECES: "Pieces",
    AGENT: "Agent",
    STAND: "Stand",
}
_OFFSET = -min(STRUCTURE)


def colour(name: str, turn: int = 0) -> RGB:
    """Return a colour that depends on the name alone, never black; `turn` when others are taken.

    >>> colour("Mug") == colour("Mug") != colour("Cup")
    True
    """
    for number in range(turn, turn + 256):
        text = name if not number else f"{name}#{number}"
        red, green, blue = blake2b(text.encode(), digest_size=3).digest()
        if red or green or blue:
            return (red, green, blue)
    raise ValueError(f"no colour for {name!r}")


def names(objects: Mapping[str, SceneObject]) -> list[str]:
    """Return every name that has a colour: the structure, then types and ids as they come."""
    found = dict.fromkeys(STRUCTURE.values())
    found.update(dict.fromkeys(thing.type for thing in objects.values()))
    found.update(dict.fromkeys(objects))
    return list(found)


@lru_cache(maxsize=32)
def assigned(all_names: tuple[str, ...]) -> Mapping[str, RGB]:
    """Return a colour for each name, no two alike; of two that clash the later one gives way."""
    found: dict[str, RGB] = {}
    taken: set[RGB] = set()
    for name in all_names:
        turn = 0
        while (one := colour(name, turn)) in taken:
            turn += 1
        taken.add(one)
        found[name] = one
    return found


def colour_table(objects: Mapping[str, SceneObject]) -> list[dict[str, Any]]:
    """Return `metadata["colors"]`: {"color": [r, g, b], "name": name} for every name."""
    table = assigned(tuple(names(objects)))
    return [{"color": list(one), "name": name} for name, one in table.items()]


def instance_frame(
    rows: NDArray[np.int32], objects: Mapping[str, SceneObject]
) -> NDArray[np.uint8]:
    """Return each pixel's object as its colour, uint8 (H, W, 3), by the rows of a `Picture`."""
    return _painted(rows, objects, list(objects))


def class_frame(rows: NDArray[np.int32], objects: Mapping[str, SceneObject]) -> NDArray[np.uint8]:
    """Return each pixel's type as its colour, uint8 (H, W, 3), by the rows of a `Picture`."""
    return _painted(rows, objects, [thing.type for thing in objects.values()])


def _painted(
    rows: NDArray[np.int32], objects: Mapping[str, SceneObject], of_rows: list[str]
) -> NDArray[np.uint8]:
    table = assigned(tuple(names(objects)))
    structure = [STRUCTURE[row] for row in range(-_OFFSET, 0)]
    colours = np.array([table[name] for name in (*structure, *of_rows)], dtype=np.uint8)
    quick = packed(colours)[rows + _OFFSET]
    return np.ascontiguousarray(quick.view(np.uint8).reshape(*rows.shape, 4)[..., :3])
