"""Build an object's triangles from its form, with what dirt, heat and cold do to any shape.

A shape is an entry of `shapes.toml`, or a function of its name in one of the modules of shapes.
"""

from collections.abc import Iterable
from functools import cache, lru_cache
from itertools import cycle
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import msgspec
import numpy as np

from karma.files import read_toml
from karma.world.render import cases, furniture, things
from karma.world.render.form import Builder, Form, dial, mix, rgb, shade
from karma.world.render.mesh import (
    GHOST,
    GLASS,
    SOLID,
    Colour,
    Mesh,
    ball,
    box,
    drum,
    finer,
    joined,
    lathe,
    mirrored,
    ring,
    rod,
    sheet,
    shifted,
    turned,
)

TABLE = Path(__file__).with_name("shapes.toml")
Length = float | tuple[float, float] | dict[str, float]  # see `shapes.toml`
Sizes = dict[str, float]  # of an object: half its width x, its height y, half its depth z, and more
Condition = Literal["broken", "cooked", "filled", "on", "opened", "used_up"]  # of a Form
_CLEAR = {"": SOLID, "glass": GLASS, "ghost": GHOST}


class ShapeMeasure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A length that other lengths of a shape are shares of."""

    least: tuple[Length, ...]
    most: Length | None = None


class Solid(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid of a shape."""

    solid: Literal[
        "ball", "box", "cracks", "dial", "drum", "frame", "lathe", "ring", "rod", "screen",
        "sheet",
    ]  # fmt: skip
    at: tuple[Length, ...]
    colour: str | tuple[str, ...] = "main"  # several: one for each band of a lathe
    radius: Length = 0.0
    thin: Length | None = None  # the radius at a rod's end
    thick: Length = 0.0
    depth: float | dict[str, float] = 1.0  # of what is round: a share of its radius, or a length
    axis: int = 1
    cells: tuple[int, int] = (1, 1)
    bump: Length = 0.0
    sides: int = 14
    rings: int = 7
    glow: bool = False
    clear: Literal["", "glass", "ghost"] = ""
    when: Condition | None = None
    unless: Condition | None = None
    turn: tuple[float, int] = (0.0, 1)  # degrees, about an axis
    about: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)  # which goes through here
    moves: tuple[tuple[Length, Length], ...] = ((0.0, 0.0),)
    swing: tuple[float, int] | None = None  # degrees when fully open, about an axis of the hinge

    def seen(self, f: Form) -> bool:
        """Return whether an object in this state shows the solid."""
        return (self.when is None or getattr(f, self.when)) and not (
            self.unless is not None and getattr(f, self.unless)
        )

    def meshes(self, f: Form, sizes: Sizes) -> list[Mesh]:
        """Return the solid of an object wherever it stands."""
        if self.solid == "frame":
            return f.frame(*_metres(self.at, "x", sizes))
        if self.solid == "cracks":
            x, low, high, front = _metres(self.at, "xyyz", sizes)
            return cases.cracks(x, low, high, front, _colour(f, str(self.colour)))
        if self.solid == "screen":
            x, low, high, front = _metres(self.at, "xyyz", sizes)
            return cases.glass(x, low, high, front, f)
        moves = [_metres(move, "xz", sizes) for move in self.moves]
        if self.turn[0]:
            x, y, z = _metres(self.about, "xyz", sizes)
            part = turned(self._mesh(f, sizes, 0.0, 0.0), *self.turn, about=(x, y, z))
            return [shifted(part, x, 0, z) for x, z in moves]
        return [self._mesh(f, sizes, x, z) for x, z in moves]

    def _mesh(self, f: Form, sizes: Sizes, by_x: float, by_z: float) -> Mesh:
        if self.solid in ("dial", "drum", "lathe"):
            return shifted(self._round(f, sizes), by_x, 0, by_z)
        at = _metres(self.at, "xyz", sizes)
        start, *more = zip(at[::3], at[1::3], at[2::3], strict=True)
        start = (start[0] + by_x, start[1], start[2] + by_z)
        colour = _colour(f, str(self.colour))
        thin = self.radius if self.thin is None else self.thin
        radius, end_radius, thick, bump = _metres(
            (self.radius, thin, self.thick, self.bump), "x", sizes
        )
        if self.solid == "sheet":
            return sheet(start, more[0], more[1], colour, cells=self.cells, bump=bump)
        if self.solid == "ring":
            return ring(
                start, radius, thick, colour, axis=self.axis, sides=self.sides, glow=self.glow
            )
        if self.solid == "ball":
            return ball(
                start, more[0], colour, sides=self.sides, rings=self.rings, glow=self.glow,
                clear=_CLEAR[self.clear],
            )  # fmt: skip
        end = (more[0][0] + by_x, more[0][1], more[0][2] + by_z)
        if self.solid == "rod":
            return rod(start, end, radius, colour, sides=self.sides, thin=end_radius)
        return box(start, end, colour, glow=self.glow, clear=_CLEAR[self.clear])

    def _round(self, f: Form, sizes: Sizes) -> Mesh:
        (radius,) = _metres((self.radius,), "x", sizes)
        names = (self.colour,) if isinstance(self.colour, str) else self.colour
        colour, *others = [_colour(f, name) for name in names]
        if self.solid == "lathe":
            depth = self._depth(radius, sizes) if self.radius else sizes["z"] / sizes["x"]
            at = _metres(self.at, "xy", {**sizes, "x": radius} if self.radius else sizes)
            return lathe(
                list(zip(at[::2], at[1::2], strict=True)), [colour, *others] if others else colour,
                sides=self.sides, depth=depth, glow=self.glow, clear=_CLEAR[self.clear],
            )  # fmt: skip
        if self.solid == "drum":
            low, high = _metres(self.at, "yy", sizes)
            depth = self._depth(radius, sizes)
            return drum(radius, low, high, colour, sides=self.sides, depth=depth, glow=self.glow)
        y, back, front = _metres(self.at, "yzz", sizes)
        return dial(radius, back, front, y, colour, sides=self.sides)

    def _depth(self, radius: float, sizes: Sizes) -> float:
        if isinstance(self.depth, dict):
            return _metres([self.depth], "x", sizes)[0] / radius
        return self.depth


def _metres(lengths: Iterable[Length], axes: str, sizes: Sizes) -> list[float]:
    """Return lengths, each a share of the next of some axes unless it says of what."""
    found = []
    for length, axis in zip(lengths, cycle(axes), strict=False):
        if isinstance(length, dict):
            found.append(sum(sizes[name] * share for name, share in length.items()))
        else:
            share, more = length if isinstance(length, tuple) else (length, 0.0)
            found.append(sizes[axis] * share + more)
    return found


def _colour(f: Form, name: str) -> Colour:
    """Return one of a form's colours, or "#rrggbb", or a mix, times the factors behind it."""
    base, *factors = name.split("*")
    if "~" in base:
        one, other, share = base.split("~")
        return mix(_colour(f, one), _colour(f, other), float(share))
    colour: Colour = rgb(base) if base.startswith("#") else getattr(f, base)
    for factor in factors:
        colour = shade(colour, float(factor))
    return colour


class ListedShape(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A shape of `shapes.toml`."""

    parts: tuple[Solid, ...]
    measures: dict[str, ShapeMeasure] = {}
    least: tuple[float, float] = (0.0, 0.0)  # width and height: less would not be seen, metres
    breaks: bool = False  # to pieces that lie about
    like: str | None = None  # a shape whose parts and measures come first
    hinge: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)  # of the parts that swing
    along: bool = False  # x is along the longer side

    def __call__(self, f: Form) -> list[Mesh]:
        """Return the solids of an object in order."""
        if self.breaks and f.broken:
            return things.shards(f)
        across = self.along and not f.along_x
        if across:
            f = f._replace(width=f.depth, depth=f.width)
        before = listed()[self.like] if self.like else ListedShape(parts=())
        f = f._replace(width=max(f.width, self.least[0]), height=max(f.height, self.least[1]))
        sizes = {**dict(zip("xyz", f.half, strict=True)), "m": 1.0}
        for name, measure in (before.measures | self.measures).items():
            least = min(_metres(measure.least, "x", sizes))
            sizes[name] = least
            if measure.most is not None:
                sizes[name] = max(least, *_metres([measure.most], "x", sizes))
        x, y, z = _metres(self.hinge, "xyz", sizes)
        meshes = []
        for part in (*before.parts, *self.parts):
            solids = part.meshes(f, sizes) if part.seen(f) else []
            if part.swing is not None and f.opened:
                degrees, axis = part.swing
                solids = [turned(one, degrees * f.openness, axis, (x, y, z)) for one in solids]
            meshes += solids
        return [turned(mesh, 90) for mesh in meshes] if across else meshes


@cache
def listed() -> MappingProxyType[str, ListedShape]:
    """Return the shapes of `shapes.toml`, read once."""
    return MappingProxyType(read_toml(TABLE, dict[str, ListedShape]))


def builder(name: str) -> Builder:
    """Return what builds the shape of this name; KeyError when nothing does."""
    modules = (furniture, cases, things)
    functions = (vars(module)[name] for module in modules if name in vars(module))
    return next(functions, None) or listed()[name]


BROWN = np.array([92.0, 62.0, 28.0], dtype=np.float32)
TINTS = {
    "Hot": (np.array([240.0, 70.0, 30.0], dtype=np.float32), 0.32),
    "Cold": (np.array([110.0, 180.0, 255.0], dtype=np.float32), 0.38),
}
_SPOTTED = 600  # faces that patches are drawn over, at least
_KEPT = 256  # shapes, some kilobytes each; shared by all worlds of a process


@lru_cache(maxsize=_KEPT)
def shape(name: str, form: Form, temperature: str) -> Mesh:
    """Return the triangles of an object, x to the left of its front; never to be written to."""
    whole = joined(builder(name)(form))
    if form.dirty and name != "bed":
        whole = _stained(whole)
    if temperature in TINTS:
        whole = _tinted(whole, temperature)
    if temperature == "Hot":
        whole = joined([whole, *_steam(whole)])
    return mirrored(whole)  # x of the builders points the other way than Unity's


def _stained(whole: Mesh) -> Mesh:
    """Return the mesh with brown patches over a good third of it."""
    while len(whole.faces) < _SPOTTED:
        whole = finer(whole)
    span = np.maximum(whole.high - whole.low, 1e-3)
    places = (whole.vertices[whole.faces].mean(axis=1) - whole.low) / span
    x, y, z = places.T
    patches = np.sin(11 * x + 4 * z + 0.6) + np.sin(9 * z - 5 * y + 1.9) + np.sin(8 * y + 3 * x)
    spotted = patches > np.quantile(patches, 0.62)
    colours = np.where(spotted[:, None], BROWN, whole.colours).astype(np.float32)
    return whole._replace(colours=colours)


def _tinted(whole: Mesh, temperature: str) -> Mesh:
    tint, share = TINTS[temperature]
    colours = whole.colours + (tint - whole.colours) * share
    return whole._replace(colours=np.where(whole.glow[:, None], whole.colours, colours))


def _steam(whole: Mesh) -> list[Mesh]:
    """Return three plumes above a hot thing."""
    low, high = whole.low, whole.high
    middle = (low + high) / 2
    wide = float(np.clip((high[0] - low[0]) * 0.12, 0.008, 0.03))
    found = []
    for number, (a, b) in enumerate(((-0.25, 0.0), (0.05, 0.2), (0.28, -0.15))):
        tall = 0.07 + 0.02 * number
        puff = lathe(
            [(0.0, 0.0), (wide, tall * 0.3), (wide * 0.45, tall * 0.55), (wide * 0.9, tall * 0.8),
             (0.0, tall)],
            (250.0, 250.0, 250.0), sides=7, glow=True, clear=GHOST,
        )  # fmt: skip
        x = float(middle[0] + a * (high[0] - low[0]))
        z = float(middle[2] + b * (high[2] - low[2]))
        found.append(shifted(puff, x, float(high[1]) + 0.008, z))
    return found
