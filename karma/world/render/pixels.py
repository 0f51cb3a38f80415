"""Turn what rays meet into colours, depths and rows of objects, and rows into AI2-THOR's masks."""

from collections.abc import Mapping
from functools import lru_cache
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.household import places
from karma.world.core.objects import Objects
from karma.world.core.scene import SceneObject
from karma.world.render import shell as rooms
from karma.world.render.layer import Layer, Rays
from karma.world.render.mesh import GHOST, GLASS, SOLID, Floats, Packed, packed
from karma.world.render.shell import Shell

# rows of what is no object
NOTHING, WALL, CEILING, FLOOR, PIECES, AGENT, STAND = -1, -2, -3, -4, -5, -6, -7
SEE_THROUGH = {GLASS: 0.35, GHOST: 0.3}  # share of the clear thing's own colour
_PANES = 6  # clear faces that one ray passes at most
_STEP_M = 1e-3  # beyond a clear face
_SUNK_M = 0.004  # what lies deeper under the floor is not seen


class Pixels(NamedTuple):
    """Flat pixels, to be written to."""

    colours: Packed  # (n,)
    depth: Floats  # (n,), from the near plane; infinite where nothing is
    rows: NDArray[np.int32]  # (n,)
    normals: Floats | None  # (n, 3)

    @property
    def parts(self) -> NDArray[np.uint8]:
        """The same colours as red, green, blue and 0, shape (n, 4)."""
        return self.colours.view(np.uint8).reshape(-1, 4)


class Scenery(NamedTuple):
    """All that rays can meet, with a colour, a row and a normal for each triangle."""

    layers: list[Layer]
    shell: Shell
    faces: NDArray[np.int32]  # (7,): row of each face of the room, last of none
    colours: Packed  # (m,)
    rows: NDArray[np.int32]  # (m,)
    clear: NDArray[np.uint8]  # (m,)
    normals: Floats  # (m, 3)
    any_clear: bool


def scenery(layers: list[Layer], shell: Shell, objects: Objects, view: Rays) -> Scenery:
    """Return what one camera sees at one moment; the last triangle is no triangle."""
    at = objects.rows
    none = np.zeros((1, 3), dtype=np.float32)
    shades = [layer.shaded(view.eye) for layer in layers]
    rows = [
        np.array([one if isinstance(one, int) else at[one] for one in layer.owners], np.int32)[
            layer.slots
        ]
        for layer in layers
    ]
    floors = objects.by_type.get(places.FLOOR, ())
    floor = at[floors[0]] if floors else FLOOR
    return Scenery(
        layers,
        shell,
        np.array([WALL, WALL, floor, CEILING, WALL, WALL, NOTHING], dtype=np.int32),
        packed(np.concatenate([*shades, none.astype(np.uint8)])),
        np.concatenate([*rows, np.array([NOTHING], dtype=np.int32)]),
        np.concatenate([*(layer.clear for layer in layers), np.array([SOLID], dtype=np.uint8)]),
        np.concatenate([*(layer.normals for layer in layers), none]),
        any(layer.any_clear for layer in layers),
    )


def look(
    seen: Scenery, view: Rays, sky: Packed, *, normals: bool = False, panes: int = _PANES
) -> Pixels:
    """Return what rays see; up to `panes` clear faces are blended with what lies behind them."""
    along, triangle = _nearest(seen.layers, view)
    found = _solid(seen, view, along, triangle, sky, normals)
    if not panes or not seen.any_clear:
        return found
    kinds = seen.clear[triangle]
    pixels = np.flatnonzero(kinds)
    if len(pixels):
        far = along[pixels] + np.float32(_STEP_M)
        beyond = view.beyond(pixels, far)
        behind = look(seen, beyond, sky, normals=normals, panes=panes - 1)
        _blend(found, behind, pixels, kinds[pixels], far)
    return found


def _nearest(layers: list[Layer], view: Rays) -> tuple[Floats, NDArray[np.int32]]:
    """Return how far each ray gets and the triangle it meets, counted through all layers."""
    along, triangle = layers[0].shot(view.origins, view.directions)
    start = len(layers[0])
    for layer in layers[1:]:
        near, which = layer.shot(view.origins, view.directions)
        closer = near < along
        along[closer], triangle[closer] = near[closer], which[closer] + start
        start += len(layer)
    return along, triangle


def _solid(
    seen: Scenery, view: Rays, along: Floats, triangle: NDArray[np.int32], sky: Packed,
    normals: bool,
) -> Pixels:  # fmt: skip
    """Return the pixels as if everything were solid; the room shows where nothing is met."""
    level = view.origins[:, 1] + along * view.steps[1]
    missed = np.flatnonzero((triangle < 0) | (level < seen.shell.low[1] - _SUNK_M))
    out = rooms.exits(seen.shell, view.eye, view.steps[:, missed])
    colours = seen.colours[triangle]
    rows = seen.rows[triangle]
    depth = along.copy()
    colours[missed] = np.where(out.face < 0, sky, seen.shell.texels[out.texel])
    rows[missed] = seen.faces[out.face]
    depth[missed] = out.along - view.passed[missed]
    turned = None
    if normals:
        turned = seen.normals[triangle]
        turned[np.einsum("ij,ij->i", turned, view.directions) > 0] *= -1
        turned[missed] = rooms.normals(out.face)
    return Pixels(colours, depth, rows, turned)


def _blend(
    found: Pixels, behind: Pixels, pixels: NDArray[np.intp], kinds: NDArray[np.uint8], far: Floats
) -> None:
    """Mix clear pixels with what is behind them; a ghost leaves depth and row to that."""
    share = np.where(kinds == GLASS, SEE_THROUGH[GLASS], SEE_THROUGH[GHOST])[:, None]
    found.parts[pixels] = found.parts[pixels] * share + behind.parts * (1 - share)
    ghosts = kinds == GHOST
    found.rows[pixels[ghosts]] = behind.rows[ghosts]
    found.depth[pixels[ghosts]] = behind.depth[ghosts] + far[ghosts]
    if found.normals is not None and behind.normals is not None:
        found.normals[pixels[ghosts]] = behind.normals[ghosts]


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
