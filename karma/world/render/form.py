"""Describe one object to its builder: its measures, colours and state, and nothing else."""

from collections.abc import Callable
from typing import NamedTuple

from karma.world.render.mesh import Colour, Mesh

Rectangle = tuple[float, float, float, float]  # x0, z0, x1, z1

WATER: Colour = (70.0, 140.0, 230.0)
COFFEE: Colour = (52.0, 28.0, 12.0)
WINE: Colour = (120.0, 10.0, 40.0)
LIQUIDS = {"water": WATER, "coffee": COFFEE, "wine": WINE}
CRACK: Colour = (12.0, 12.0, 14.0)


class Form(NamedTuple):
    """One object in its own frame: width along x, height along y from 0, depth along z (front)."""

    style: str
    width: float
    height: float
    depth: float
    main: Colour
    second: Colour
    third: Colour
    openness: float = 0.0
    on: bool = False
    broken: bool = False
    filled: bool = False
    liquid: Colour = WATER
    dirty: bool = False
    used_up: bool = False
    cooked: bool = False
    filled_parts: tuple[Rectangle, ...] = ()  # of the ground; () = all of it

    @property
    def half(self) -> tuple[float, float, float]:
        """Half the width and depth with the height between them."""
        return self.width / 2, self.height, self.depth / 2


Builder = Callable[[Form], list[Mesh]]


def shade(colour: Colour, by: float) -> Colour:
    """Return a darker (below 1) or lighter (above 1) colour."""
    red, green, blue = (min(255.0, part * by) for part in colour)
    return (red, green, blue)


def mix(one: Colour, other: Colour, share: float) -> Colour:
    """Return the colour between two, `share` of the way to the other."""
    red, green, blue = (a + (b - a) * share for a, b in zip(one, other, strict=True))
    return (red, green, blue)
