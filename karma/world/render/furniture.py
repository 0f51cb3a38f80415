"""Build tables, seats, beds, shelves and chests."""

import itertools
from collections.abc import Callable
from types import MappingProxyType
from typing import NamedTuple

from karma.world.render.form import SIDES, Form, Rectangle, shade
from karma.world.render.mesh import Mesh, ball, box, sheet, turned


class Surface(NamedTuple):
    """Where things rest on a piece of furniture as it is drawn."""

    level: Callable[[float], float]  # above its foot, of its height
    lift_m: float  # things that lie at most this much deeper are drawn on it


def _sofa_level(height: float) -> float:
    return min(0.42, height * 0.5)


def _bed_level(height: float) -> float:
    return min(0.5, height * 0.62)


SURFACES = MappingProxyType(
    {
        **dict.fromkeys(
            ("counter", "table", "side_table", "desk", "chest", "stand"),
            Surface(lambda height: height, 0.04),
        ),
        "sofa": Surface(_sofa_level, 0.2),
        "bed": Surface(lambda height: _bed_level(height) + 0.045, 0.2),
    }
)


def sofa(f: Form) -> list[Mesh]:
    """Return a seat with arms, a back and one cushion for each place."""
    x, y, z = f.half
    arm, deep = min(0.2, f.width * 0.16), min(0.24, f.depth * 0.28)
    back = -z + deep
    level = _sofa_level(y)
    seat = level * 0.7
    light = shade(f.main, 1.14)
    parts = [
        box((-x, 0.05, -z), (x, seat, z), shade(f.main, 0.85)),
        box((-x + arm, level * 0.6, -z), (x - arm, y, back), f.main),
        box((-x, 0.05, -z), (-x + arm, y * 0.72, z), f.main),
        box((x - arm, 0.05, -z), (x, y * 0.72, z), f.main),
    ]
    inner = f.width - 2 * arm
    places = max(1, round(inner / 0.65))
    for place in range(places):
        low = -inner / 2 + place * inner / places
        high = low + inner / places
        parts.append(box((low + 0.01, seat, back), (high - 0.01, level, z * 0.97), light))
        upper = (high - 0.015, y * 0.96, -z + deep * 1.5)
        parts.append(box((low + 0.015, level, back), upper, light))
    for a, b in itertools.product((0.05 - x, x - 0.05), (0.05 - z, z - 0.05)):
        parts.append(box((a - 0.03, 0, b - 0.03), (a + 0.03, 0.05, b + 0.03), f.second))
    return parts


def bed(f: Form) -> list[Mesh]:
    """Return a bed, its head at the back; dirty = the blanket lies rumpled."""
    x, y, z = f.half
    level = _bed_level(y)
    parts = [
        box((-x, 0.08, -z), (x, level * 0.6, z), f.second),
        box((-x, 0, -z), (x, y, -z + 0.06), f.second),
        box((-x * 0.97, level * 0.6, -z + 0.06), (x * 0.97, level, z * 0.98), f.third),
    ]
    for a in SIDES:
        parts.append(box((a * x - 0.04 * a, 0, z - 0.06), (a * x, level * 0.7, z), f.second))
    heads = (-0.5, 0.5) if f.width > 1.2 else (0.0,)
    half = (x * (0.4 if len(heads) == 2 else 0.7), 0.07, min(0.24, z * 0.24))
    for head in heads:
        tilt = (25 if f.dirty else 0) * (1 if head < 0 else -2)
        puff = ball((head * x, level + 0.06, -z + 0.34), half, shade(f.third, 0.97), sides=10)
        parts.append(turned(puff, tilt, about=(head * x, 0, -z + 0.34)))
    return parts + (_rumpled(f, level) if f.dirty else _made(f, level))


def _made(f: Form, level: float) -> list[Mesh]:
    x, _, z = f.half
    fold = -z + f.depth * 0.32
    return [
        box((-x, level * 0.5, fold), (x, level + 0.035, z), f.main),
        box((-x, level * 0.9, fold - 0.1), (x, level + 0.045, fold + 0.06), f.third),
    ]


def _rumpled(f: Form, level: float) -> list[Mesh]:
    x, _, z = f.half
    parts = [
        sheet((-x * 0.7, level + 0.06, z * 0.98), (x * 1.65, 0.02, -0.1 * z),
              (0.12 * x, 0.05, -f.depth * 0.5), f.main, cells=(12, 12), bump=0.06),
        sheet((-x * 0.2, level + 0.1, z * 0.5), (x * 0.9, 0.05, 0.3), (-0.1, 0.06, -f.depth * 0.32),
              shade(f.main, 0.8), cells=(8, 8), bump=0.07),
    ]  # fmt: skip
    for a, b, size in ((-0.3, 0.1, 0.3), (0.35, -0.05, 0.24), (0.1, 0.35, 0.28)):
        lump = ball((a * x, level, b * z), (size * x, 0.13, size * z * 0.6), shade(f.main, 0.9))
        parts.append(lump)
    return parts


def counter(f: Form) -> list[Mesh]:
    """Return a worktop, only over the ground that is filled, with back panels where it is thick."""
    x, y, z = f.half
    ground: tuple[Rectangle, ...] = f.filled_parts or ((-x, -z, x, z),)
    top = y - min(y, 0.06)
    panels = [one for one in ground if one[1] <= -z + 0.01] if top >= 0.2 else []
    return [
        *[box((x0, top, z0), (x1, y, z1), f.main) for x0, z0, x1, z1 in ground],
        *[
            box((x0 + 0.02, 0.0, z0), (x1 - 0.02, top, min(z0 + 0.03, z1)), f.second)
            for x0, z0, x1, z1 in panels
        ],
    ]


def chest(f: Form) -> list[Mesh]:
    """Return a dresser with drawer fronts."""
    x, y, z = f.half
    front = z - 0.02
    parts = [
        box((-x, y - 0.04, -z), (x, y, z), shade(f.main, 1.1)),
        box((-x, 0.04, -z), (x, y - 0.04, front), f.main),
    ]
    columns, rows = max(1, round(f.width / 0.6)), max(1, round(y / 0.3))
    for column, row in itertools.product(range(columns), range(rows)):
        x0, x1 = (-x + f.width * (column + side) / columns for side in (0.04, 0.96))
        y0, y1 = (0.06 + (y - 0.12) * (row + side) / rows for side in (0.05, 0.95))
        middle = ((x0 + x1) / 2, (y0 + y1) / 2, z)
        parts.append(box((x0, y0, front), (x1, y1, z - 0.005), shade(f.main, 1.2)))
        parts.append(ball(middle, (0.02, 0.02, 0.02), f.third, sides=6, rings=4))
    return parts


def shelves(f: Form) -> list[Mesh]:
    """Return an open case of shelves with a back."""
    x, y, z = f.half
    count = max(2, round(y / 0.36))
    levels = [0.02 + (y - 0.04) * board / count for board in range(count + 1)]
    return [
        box((-x, 0, -z), (-x + 0.03, y, z), f.main),
        box((x - 0.03, 0, -z), (x, y, z), f.main),
        box((-x, 0, -z), (x, y, -z + 0.01), f.second),
        *[box((-x, at - 0.015, -z), (x, at + 0.015, z * 0.98), f.main) for at in levels],
    ]
