"""Build furniture and fixtures: seats, beds, worktops, shelves; basins, doors, curtains, knobs."""

import itertools
from collections.abc import Callable
from math import cos, sin
from types import MappingProxyType
from typing import NamedTuple

from karma.world.render.cases import cracks
from karma.world.render.form import SIDES, WATER, Form, Rectangle, dial, shade
from karma.world.render.mesh import (
    GHOST,
    Mesh,
    ball,
    bent,
    box,
    drum,
    lathe,
    rod,
    sheet,
    shifted,
    turned,
)


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


# ------------------------------------------------------------------ fixtures


def basin(f: Form) -> list[Mesh]:
    """Return a tub, a sink's rim round its basin, or the basin itself."""
    x, y, z = f.half
    if f.style == "rim" and f.filled_parts:
        low = max(0.0, y - 0.02)
        return [box((x0, low, z0), (x1, y, z1), f.main) for x0, z0, x1, z1 in f.filled_parts]
    wall = min(0.08 if f.style == "tub" else 0.02, x * 0.2, z * 0.2)
    floor = y * (0.22 if f.style == "tub" else 0.06)
    return [
        box((-x, 0, -z), (-x + wall, y, z), f.main),
        box((x - wall, 0, -z), (x, y, z), f.main),
        box((-x, 0, -z), (x, y, -z + wall), f.main),
        box((-x, 0, z - wall), (x, y, z), f.main),
        box((-x + wall, 0, -z + wall), (x - wall, floor, z - wall), shade(f.main, 0.9)),
        drum(min(x, z) * 0.12, floor, floor + 0.004, f.second),
    ]


def shower_head(f: Form) -> list[Mesh]:
    """Return a shower head on its arm, or on a pole when it is tall; on, it rains."""
    x, y, z = f.half
    pole = y > 0.6
    top = y * 0.97
    head_y = y * (0.88 if pole else 0.45)
    low = head_y - 0.02
    wide = min(x, z) * 0.75
    front = z - wide if z > wide else 0.0
    arm = [
        (0.0, 0.0 if pole else y * 0.8, -z), (0.0, top, -z * 0.9), (0.0, top, front),
        (0.0, head_y + 0.03, front),
    ]  # fmt: skip
    parts = [
        *bent(arm, max(0.012, wide * 0.08), f.main),
        shifted(lathe([(wide * 0.3, head_y + 0.05), (wide, head_y)], f.main), 0, 0, front),
        shifted(drum(wide, low, head_y, shade(f.main, 0.8)), 0, 0, front),
    ]
    for drop in range(10 if f.on else 0):
        angle, far = drop * 2.4, wide * 0.9 * (drop / 10) ** 0.5
        a, b = sin(angle) * far, front + cos(angle) * far
        parts += [
            rod((a, low, b), (a, head_y - 0.65, b), 0.006, WATER, sides=4, clear=GHOST),
            rod((a, low, b), (a, head_y - 0.1, b), 0.008, WATER, sides=4),
        ]
    return parts


def curtain(f: Form) -> list[Mesh]:
    """Return folds of cloth on a rod; an open shower curtain is pushed aside."""
    x, y, z = f.half
    parts = [rod((-x, 0.985 * y, 0), (x, 0.985 * y, 0), min(0.02, z), f.second, sides=6)]
    spans = [(-x, -x * 0.45), (x * 0.45, x)]
    if f.style == "shower":
        spans = [(-x, x - f.openness * 1.4 * x)]
    for low, high in spans:
        folds = max(3, round((high - low) / 0.09))
        step = (high - low) / folds
        for fold in range(folds):
            colour = f.main if fold % 2 else shade(f.main, 0.82)
            wave = drum(step * 0.62, 0.0, y * 0.97, colour, sides=6, depth=z / step)
            parts.append(shifted(wave, low + step * (fold + 0.5)))
    return parts


def blinds(f: Form) -> list[Mesh]:
    """Return slats: drawn up to a bundle when open, all the way down the box when closed."""
    x, y, z = f.half
    top = y - min(0.05, y * 0.25)
    parts = [box((-x, top, -z), (x, y, z), shade(f.second, 0.9))]
    low = top * min(f.openness, 1.0) * 0.75
    count = max(3, min(24, round(top / 0.045)))
    for slat in range(count):
        level = low + (top - low) * (slat + 0.5) / count
        colour = f.main if slat % 2 else f.second
        high = (top - low) / count * 0.42
        parts.append(box((-x, level - high, -z * 0.6), (x, level + high, z * 0.7), colour))
    if f.openness > 0:
        parts.append(rod((x * 0.8, 0, 0), (x * 0.8, low, 0), 0.006, (90.0, 90.0, 90.0), sides=4))
    return parts


def knob(f: Form) -> list[Mesh]:
    """Return a knob whose mark stands upright when off, and across, lit, when on."""
    x, y, z = f.half
    lying = y < min(f.width, f.depth)
    radius = min(x, z) if lying else min(x, y / 2)
    mark = f.third if f.on else f.second
    long, short = radius * 0.95, radius * 0.24
    a, b = (long, short) if f.on else (short, long)
    if lying:
        return [
            drum(radius, 0, y * 0.8, f.main),
            box((-a, y * 0.8, -b), (a, y, b), mark, glow=f.on),
        ]
    return [
        dial(radius, -z, z * 0.7, y / 2, f.main),
        box((-a, y / 2 - b, z * 0.7), (a, y / 2 + b, z), mark, glow=f.on),
    ]


def phone(f: Form) -> list[Mesh]:
    """Return a phone, lying: dark, lit with icons, or cracked."""
    f = f.at_least(0.004)
    x, y, z = f.half
    lit = f.on and not f.broken
    dark = (8.0, 9.0, 12.0) if not f.broken else (44.0, 46.0, 50.0)
    shine = f.third if lit else dark
    parts = [
        f.box((-1, 0, -1), (1, 1, 1), f.second),
        box((-0.88 * x, y, -0.86 * z), (0.88 * x, y + 0.001, 0.86 * z), shine, glow=lit),
    ]
    if lit:
        side, places = x * 0.14, (-0.5, 0.0, 0.5)
        for a, b in ((p * x, q * z) for p in places for q in places):
            low, high = (a - side, y, b - side), (a + side, y + 0.002, b + side)
            parts.append(box(low, high, (255.0, 255.0, 255.0), glow=True))
    if f.broken:
        flat = cracks(x * 0.85, -z * 0.84, z * 0.84, 0.0, (235.0, 238.0, 240.0))
        parts += [shifted(turned(part, -90, axis=0), 0, y + 0.001, 0) for part in flat]
    return parts
