"""Build an object's triangles from its form, with what dirt, heat and cold do to any shape.

A shape is an entry of `shapes.toml`, or a function of its name in one of the modules of shapes.
"""

from functools import cache, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import msgspec
import numpy as np

from karma.files import read_toml
from karma.world.render import cases, dishes, fixtures, furniture, machines, things
from karma.world.render.form import Builder, Form, shade
from karma.world.render.looks import rgb
from karma.world.render.mesh import (
    GHOST,
    GLASS,
    SOLID,
    Colour,
    Mesh,
    Point,
    ball,
    box,
    drum,
    finer,
    joined,
    lathe,
    mirrored,
    ring,
    rod,
    shifted,
)

TABLE = Path(__file__).with_name("shapes.toml")
Length = float | tuple[float, float]  # a share of a side, or a share and metres
Condition = Literal["filled", "on", "opened", "used_up"]  # of a Form


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid of a shape; `shapes.toml` says what its numbers are."""

    solid: Literal["ball", "box", "drum", "lathe", "ring", "rod"]
    at: tuple[Length, ...]
    colour: str | tuple[str, ...] = "main"  # several: one for each band of a lathe
    radius: Length = 0.0
    thick: float = 0.0
    sides: int = 14
    rings: int = 7
    glow: bool = False
    glass: bool = False
    when: Condition | None = None
    unless: Condition | None = None
    moves: tuple[tuple[float, float], ...] = ((0.0, 0.0),)

    def seen(self, f: Form) -> bool:
        """Return whether an object in this state shows the solid."""
        return (self.when is None or getattr(f, self.when)) and not (
            self.unless is not None and getattr(f, self.unless)
        )

    def mesh(self, f: Form, move_x: float, move_z: float) -> Mesh:
        """Return the solid of an object, moved by shares of its half sides."""
        x, y, z = f.half
        by_x, by_z, radius = move_x * x, move_z * z, _metres(self.radius, x)
        names = (self.colour,) if isinstance(self.colour, str) else self.colour
        colour, *others = [_colour(f, name) for name in names]
        if self.solid == "lathe":
            points = zip(self.at[::2], self.at[1::2], strict=True)
            profile = [(_metres(a, x), _metres(b, y)) for a, b in points]
            return lathe(
                profile, [colour, *others] if others else colour, sides=self.sides, depth=z / x,
                clear=GLASS if self.glass else SOLID,
            )  # fmt: skip
        if self.solid == "drum":
            a, c, low, high = map(_metres, self.at, (x, z, y, y))
            return shifted(drum(radius, low, high, colour, sides=self.sides), a + by_x, 0, c + by_z)
        start, end = _point(f, self.at[:3], by_x, by_z), _point(f, self.at[3:], by_x, by_z)
        if self.solid == "ring":
            return ring(start, radius, x * self.thick, colour, sides=self.sides, glow=self.glow)
        if self.solid == "ball":
            return ball(start, end, colour, sides=self.sides, rings=self.rings, glow=self.glow)
        if self.solid == "rod":
            return rod(start, end, radius, colour, sides=self.sides, glow=self.glow)
        return box(start, end, colour, glow=self.glow)


def _metres(length: Length, side: float) -> float:
    return side * length[0] + length[1] if isinstance(length, tuple) else side * length


def _point(f: Form, lengths: tuple[Length, ...], by_x: float, by_z: float) -> Point:
    x, y, z = map(_metres, lengths or (0.0, 0.0, 0.0), f.half)
    return (x + by_x, y, z + by_z)


def _colour(f: Form, name: str) -> Colour:
    """Return one of a form's colours, or "#rrggbb", times the factors behind it."""
    base, *factors = name.split("*")
    colour: Colour = rgb(base) if base.startswith("#") else getattr(f, base)
    for factor in factors:
        colour = shade(colour, float(factor))
    return colour


class PartList(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A shape of `shapes.toml`."""

    parts: tuple[Part, ...]
    least: tuple[float, float] = (0.0, 0.0)  # width and height: less would not be seen, metres
    breaks: bool = False  # to pieces that lie about

    def __call__(self, f: Form) -> list[Mesh]:
        """Return the solids of an object in order."""
        if self.breaks and f.broken:
            return dishes.shards(f)
        width, height = self.least
        f = f._replace(width=max(f.width, width), height=max(f.height, height))
        return [p.mesh(f, x, z) for p in self.parts if p.seen(f) for x, z in p.moves]


@cache
def listed() -> MappingProxyType[str, PartList]:
    """Return the shapes of `shapes.toml`, read once."""
    return MappingProxyType(read_toml(TABLE, dict[str, PartList]))


def builder(name: str) -> Builder:
    """Return what builds the shape of this name; KeyError when nothing does."""
    modules = (dishes, furniture, cases, fixtures, machines, things)
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
