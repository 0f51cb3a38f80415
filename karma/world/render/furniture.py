"""Build tables, seats, beds, shelves and chests."""

import itertools
from collections.abc import Callable
from types import MappingProxyType
from typing import NamedTuple

from karma.world.render.form import Builder, Form, Rectangle, shade
from karma.world.render.mesh import Mesh, ball, box, drum, lathe, rod, sheet, slab, turned


class Surface(NamedTuple):
    """Where things rest on a piece of furniture as it is drawn."""

    level: Callable[[float], float]  # above its foot, of its height
    lift_m: float  # things that lie at most this much deeper are drawn on it


def _chair_level(height: float) -> float:
    return min(0.46, height * 0.52)


def _sofa_level(height: float) -> float:
    return min(0.42, height * 0.5)


def _bed_level(height: float) -> float:
    return min(0.5, height * 0.62)


def _top(height: float) -> float:
    return height


SURFACES = MappingProxyType(
    {
        "counter": Surface(_top, 0.04),
        "table": Surface(_top, 0.04),
        "chest": Surface(_top, 0.04),
        "sofa": Surface(_sofa_level, 0.2),
        "bed": Surface(lambda height: _bed_level(height) + 0.045, 0.2),
    }
)


def block(f: Form) -> list[Mesh]:
    """Return a plain box."""
    return [slab(f.width, f.depth, 0, f.height, f.main)]


def table(f: Form) -> list[Mesh]:
    """Return a top on four legs; with a drawer front or a back panel by style."""
    x, y, z = f.half
    thick = min(0.05, y * 0.12)
    leg = min(0.06, x * 0.16, z * 0.16)
    parts = [slab(f.width, f.depth, y - thick, y, f.main)]
    apron = min(0.08, y * 0.15)
    parts.append(slab(f.width * 0.9, f.depth * 0.9, y - thick - apron, y - thick, f.second))
    for a in (-1, 1):
        for b in (-1, 1):
            px, pz = a * (x - leg * 0.8), b * (z - leg * 0.8)
            parts.append(
                box(
                    (px - leg / 2, 0, pz - leg / 2),
                    (px + leg / 2, y - thick, pz + leg / 2),
                    f.second,
                )
            )
    if f.style == "drawer":
        front = z * 0.97
        parts.append(slab(f.width * 0.9, f.depth * 0.94, y * 0.66, y - thick, f.second))
        parts.append(
            box((-x * 0.8, y * 0.7, front - 0.01), (x * 0.8, y - thick * 1.5, front), f.main)
        )
        parts.append(_handle(0.0, y * 0.8, front, 0.08))
        parts.append(slab(f.width * 0.85, f.depth * 0.85, y * 0.18, y * 0.2, f.second))
    if f.style == "back":
        parts.append(
            box((-x * 0.95, y * 0.35, -z * 0.96), (x * 0.95, y - thick, -z * 0.9), f.second)
        )
    return parts


def _handle(x: float, y: float, z: float, wide: float, *, tall: bool = False) -> Mesh:
    a, b = (0.012, wide / 2) if tall else (wide / 2, 0.012)
    return box((x - a, y - b, z), (x + a, y + b, z + 0.02), (70.0, 66.0, 60.0))


def seat(f: Form) -> list[Mesh]:
    """Return a chair, a stool or a cushioned footstool."""
    return {"chair": _chair, "stool": _stool, "cushion": _cushion}[f.style](f)


def _chair(f: Form) -> list[Mesh]:
    x, y, z = f.half
    level = _chair_level(y)
    leg = min(0.04, x * 0.2)
    parts = [slab(f.width, f.depth * 0.96, level - 0.05, level, f.main)]
    for a in (-1, 1):
        px = a * (x - leg)
        parts.append(
            box((px - leg / 2, 0, z - leg * 1.5), (px + leg / 2, level, z - leg / 2), f.second)
        )
        parts.append(box((px - leg / 2, 0, -z), (px + leg / 2, y, -z + leg), f.second))
    for low, high in ((0.62, 0.72), (0.78, 1.0)):
        parts.append(box((-x + leg, y * low, -z + 0.005), (x - leg, y * high, -z + 0.03), f.main))
    return parts


def _stool(f: Form) -> list[Mesh]:
    x, y, z = f.half
    parts = [drum(x, y * 0.92, y, f.main, depth=z / x, sides=16)]
    for a in (-1, 1):
        for b in (-1, 1):
            foot, top = (a * x * 0.8, 0.0, b * z * 0.8), (a * x * 0.5, y * 0.92, b * z * 0.5)
            parts.append(rod(foot, top, min(x, z) * 0.11, f.second, sides=6))
    ring = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    for (a, b), (c, d) in itertools.pairwise(ring):
        low = y * 0.3
        start, end = (a * x * 0.7, low, b * z * 0.7), (c * x * 0.7, low, d * z * 0.7)
        parts.append(rod(start, end, min(x, z) * 0.06, f.second, sides=4))
    return parts


def _cushion(f: Form) -> list[Mesh]:
    x, y, z = f.half
    parts = [
        slab(f.width, f.depth, y * 0.3, y * 0.8, f.main),
        slab(f.width * 0.96, f.depth * 0.96, y * 0.8, y, shade(f.main, 1.15)),
    ]
    for a in (-1, 1):
        for b in (-1, 1):
            px, pz = a * x * 0.85, b * z * 0.85
            parts.append(box((px - 0.03, 0, pz - 0.03), (px + 0.03, y * 0.3, pz + 0.03), f.second))
    return parts


def sofa(f: Form) -> list[Mesh]:
    """Return a seat with arms, a back and one cushion for each place."""
    x, y, z = f.half
    arm = min(0.2, f.width * 0.16)
    back = min(0.24, f.depth * 0.28)
    level = _sofa_level(y)
    dark = shade(f.main, 0.85)
    parts = [
        box((-x, 0.05, -z), (x, level * 0.7, z), dark),
        box((-x + arm, level * 0.6, -z), (x - arm, y, -z + back), f.main),
        box((-x, 0.05, -z), (-x + arm, y * 0.72, z), f.main),
        box((x - arm, 0.05, -z), (x, y * 0.72, z), f.main),
    ]
    inner = f.width - 2 * arm
    places = max(1, round(inner / 0.65))
    for place in range(places):
        low = -inner / 2 + place * inner / places
        high = low + inner / places
        light = shade(f.main, 1.14)
        parts.append(
            box((low + 0.01, level * 0.7, -z + back), (high - 0.01, level, z * 0.97), light)
        )
        parts.append(
            box((low + 0.015, level, -z + back), (high - 0.015, y * 0.96, -z + back * 1.5), light)
        )
    for a in (-1, 1):
        for b in (-1, 1):
            px, pz = a * (x - 0.05), b * (z - 0.05)
            parts.append(box((px - 0.03, 0, pz - 0.03), (px + 0.03, 0.05, pz + 0.03), f.second))
    return parts


def bed(f: Form) -> list[Mesh]:
    """Return a bed, its head at the back; dirty = the blanket lies rumpled."""
    x, y, z = f.half
    level = _bed_level(y)
    frame, sheets = f.second, f.third
    parts = [
        box((-x, 0.08, -z), (x, level * 0.6, z), frame),
        box((-x, 0, -z), (x, y, -z + 0.06), frame),
        box((-x * 0.97, level * 0.6, -z + 0.06), (x * 0.97, level, z * 0.98), sheets),
    ]
    for a in (-1, 1):
        parts.append(box((a * x - 0.04 * a, 0, z - 0.06), (a * x, level * 0.7, z), frame))
    heads = (-0.5, 0.5) if f.width > 1.2 else (0.0,)
    for head in heads:
        half = (x * (0.4 if len(heads) == 2 else 0.7), 0.07, min(0.24, z * 0.24))
        tilt = 25 if f.dirty else 0
        puff = ball((head * x, level + 0.06, -z + 0.34), half, shade(sheets, 0.97), sides=10)
        parts.append(turned(puff, tilt * (1 if head < 0 else -2), about=(head * x, 0, -z + 0.34)))
    parts += _rumpled(f, level) if f.dirty else _made(f, level)
    return parts


def _made(f: Form, level: float) -> list[Mesh]:
    x, _, z = f.half
    fold = -z + f.depth * 0.32
    return [
        box((-x * 1.0, level * 0.5, fold), (x * 1.0, level + 0.035, z), f.main),
        box((-x * 1.0, level * 0.9, fold - 0.1), (x * 1.0, level + 0.045, fold + 0.06), f.third),
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
    """Return a worktop, only over the ground that is filled, with a plinth where it is thick."""
    x, y, z = f.half
    ground = f.filled_parts or ((-x, -z, x, z),)
    thick = min(y, 0.06)
    return [box((x0, y - thick, z0), (x1, y, z1), f.main) for x0, z0, x1, z1 in ground] + _bodies(
        f, ground, y - thick
    )


def _bodies(f: Form, ground: tuple[Rectangle, ...], top: float) -> list[Mesh]:
    """Return back panels under a worktop whose box reaches further down."""
    if top < 0.2:
        return []
    z = f.depth / 2
    return [
        box((x0 + 0.02, 0.0, z0), (x1 - 0.02, top, min(z0 + 0.03, z1)), f.second)
        for x0, z0, x1, z1 in ground
        if z0 <= -z + 0.01
    ]


def chest(f: Form) -> list[Mesh]:
    """Return a dresser with drawer fronts, or a low stand with an open middle."""
    x, y, z = f.half
    open_style = f.style == "open"
    body_front = z - 0.02
    parts = [box((-x, y - 0.04, -z), (x, y, z), shade(f.main, 1.1))]
    if open_style:
        parts += [
            box((-x, 0, -z), (-x + 0.04, y, body_front), f.main),
            box((x - 0.04, 0, -z), (x, y, body_front), f.main),
            box((-x, 0, -z), (x, y, -z + 0.02), f.second),
            box((-x, 0.0, -z), (x, 0.06, body_front), f.main),
            box((-x, y * 0.45, -z), (x, y * 0.5, body_front - 0.03), f.main),
        ]
        return parts
    parts.append(box((-x, 0.04, -z), (x, y - 0.04, body_front), f.main))
    columns, rows = max(1, round(f.width / 0.6)), max(1, round(y / 0.3))
    for column in range(columns):
        for row in range(rows):
            x0, x1 = (-x + f.width * (column + side) / columns for side in (0.04, 0.96))
            y0, y1 = (0.06 + (y - 0.12) * (row + side) / rows for side in (0.05, 0.95))
            parts.append(box((x0, y0, body_front), (x1, y1, z - 0.005), shade(f.main, 1.2)))
            knob = ball(
                ((x0 + x1) / 2, (y0 + y1) / 2, z), (0.02, 0.02, 0.02), f.third, sides=6, rings=4
            )
            parts.append(knob)
    return parts


def shelf(f: Form) -> list[Mesh]:
    """Return one board at the bottom of the box, on brackets when there is room."""
    x, _, z = f.half
    thick = min(f.height, 0.03)
    parts = [slab(f.width, f.depth, 0, thick, f.main)]
    for side in (-0.8, 0.8):
        parts.append(
            box((side * x - 0.01, 0, -z), (side * x + 0.01, thick * 0.9, z * 1.005), f.second)
        )
    return parts


def shelves(f: Form) -> list[Mesh]:
    """Return an open case of shelves with a back."""
    x, y, z = f.half
    parts = [
        box((-x, 0, -z), (-x + 0.03, y, z), f.main),
        box((x - 0.03, 0, -z), (x, y, z), f.main),
        box((-x, 0, -z), (x, y, -z + 0.01), f.second),
    ]
    count = max(2, round(y / 0.36))
    for board in range(count + 1):
        level = 0.02 + (y - 0.04) * board / count
        parts.append(box((-x, level - 0.015, -z), (x, level + 0.015, z * 0.98), f.main))
    return parts


def dog_bed(f: Form) -> list[Mesh]:
    """Return a padded ring round a soft middle."""
    x, y, z = f.half
    rim = lathe(
        [
            (x * 0.8, 0),
            (x, y * 0.3),
            (x, y * 0.7),
            (x * 0.86, y),
            (x * 0.7, y * 0.6),
            (x * 0.66, 0.0),
        ],
        f.main,
        depth=z / x,
        sides=18,
    )
    return [rim, drum(x * 0.72, 0, y * 0.45, f.second, depth=z / x, sides=18)]


BUILDERS: dict[str, Builder] = {
    "block": block, "table": table, "seat": seat, "sofa": sofa, "bed": bed, "counter": counter,
    "chest": chest, "shelf": shelf, "shelves": shelves, "dog_bed": dog_bed,
}  # fmt: skip
