"""Build furniture with doors and drawers: closed it is solid in front, open one sees into it."""

import itertools

from karma.world.render.form import CRACK, Builder, Form, shade
from karma.world.render.mesh import (
    Colour,
    Mesh,
    ball,
    box,
    drum,
    joined,
    lathe,
    ring,
    rod,
    sheet,
    turned,
)

WALL_M = 0.018
SWING_DEG = 100.0
SLIDE = 0.7  # of a drawer's depth, fully open


def case(f: Form) -> list[Mesh]:
    """Return a cabinet, fridge, microwave or safe: five walls and a door hinged on the left."""
    x, _y, z = f.half
    wall = min(WALL_M * (2.5 if f.style in ("fridge", "safe", "microwave") else 1.0), x * 0.2)
    parts = _hollow(f, wall)
    parts += _inside(f, wall)
    front = {"fridge": _fridge_door, "microwave": _oven_door, "safe": _safe_door}.get(
        f.style, _cabinet_door
    )
    door = joined(front(f))
    if f.openness > 0:
        door = turned(door, -SWING_DEG * f.openness, about=(-x, 0, z))
    return [*parts, door, *_beside(f)]


def _hollow(f: Form, wall: float) -> list[Mesh]:
    x, y, z = f.half
    x1 = x - f.width * 0.24 if f.style == "microwave" else x
    out, inner = f.main, f.third
    return [
        box((-x, 0, -z), (-x + wall, y, z - wall), out),
        box((x1 - wall, 0, -z), (x, y, z - wall), out),
        box((-x, 0, -z), (x, wall, z - wall), out),
        box((-x, y - wall, -z), (x, y, z - wall), out),
        box((-x, 0, -z), (x, y, -z + wall), out),
        _lining(f, wall, x1, inner),
    ]


def _lining(f: Form, wall: float, x1: float, colour: Colour) -> Mesh:
    """Return the inner faces, a millimetre before the walls."""
    x, y, z = f.half
    a, b = wall + 0.001, wall + 0.003
    return joined(
        [
            box((-x + a, a, -z + a), (x1 - a, y - a, -z + b), shade(colour, 0.9)),
            box((-x + a, a, -z + a), (-x + b, y - a, z - wall), colour),
            box((x1 - b, a, -z + a), (x1 - a, y - a, z - wall), colour),
            box((-x + a, a, -z + a), (x1 - a, b, z - wall), shade(colour, 0.95)),
            box((-x + a, y - b, -z + a), (x1 - a, y - a, z - wall), colour),
        ]
    )


def _inside(f: Form, wall: float) -> list[Mesh]:
    x, y, z = f.half
    if f.style == "fridge":
        return [
            box(
                (-x + wall, y * level, -z + wall),
                (x - wall, y * level + 0.008, -z + f.depth * 0.3),
                (170.0, 200.0, 215.0),
            )
            for level in (0.25, 0.5, 0.75)
        ]
    if f.style == "microwave":
        turntable = drum(min(x * 0.6, z * 0.75), wall + 0.003, wall + 0.009, (190.0, 205.0, 210.0))
        lamp = box(
            (-x * 0.5, y - wall - 0.012, -z * 0.3), (x * 0.1, y - wall - 0.004, z * 0.3),
            (255.0, 225.0, 120.0), glow=True,
        )  # fmt: skip
        return [turntable, lamp] if f.on else [turntable]
    return []


def _cabinet_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    edge = min(0.05, x * 0.3, y * 0.2)
    gap = min(0.006, x * 0.05)
    return [
        box((-x + gap, gap, z - WALL_M), (x - gap, y - gap, z - 0.004), f.main),
        box((-x + edge, edge, z - 0.004), (x - edge, y - edge, z - 0.002), shade(f.main, 0.86)),
        box(
            (-x + edge * 1.4, edge * 1.4, z - 0.002),
            (x - edge * 1.4, y - edge * 1.4, z),
            shade(f.main, 1.06),
        ),
        box((x - edge * 0.8, y * 0.42, z), (x - edge * 0.5, y * 0.58, z + 0.02), f.second),
    ]


def _fridge_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    split = y * 0.64
    parts = []
    for low, high in ((0.02, split), (split + 0.012, y)):
        parts.append(box((-x, low, z - 0.05), (x, high, z), f.main))
        middle = (low + high) / 2
        reach = (high - low) * 0.28
        parts.append(rod((x - 0.07, middle - reach, z + 0.03), (x - 0.07, middle + reach, z + 0.03),
                         0.014, f.second))  # fmt: skip
    parts.append(box((-x, split, z - 0.05), (x, split + 0.012, z - 0.01), f.second))
    parts.append(
        box((-x + 0.03, 0.08, z - 0.062), (x - 0.03, y * 0.96, z - 0.05), shade(f.third, 0.95))
    )
    return parts


def _oven_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    right = x - f.width * 0.24
    pane = (255.0, 200.0, 90.0) if f.on else f.second
    return [
        box((-x, 0, z - 0.04), (right, y, z), f.main),
        box((-x + 0.03, y * 0.16, z - 0.001), (right - 0.05, y * 0.84, z + 0.002), pane, glow=f.on),
        *[
            box((-x + 0.03, y * level, z), (right - 0.05, y * level + 0.006, z + 0.003), f.second)
            for level in (0.3, 0.45, 0.6, 0.75)
        ],
        rod(
            (right - 0.025, y * 0.15, z + 0.02), (right - 0.025, y * 0.85, z + 0.02), 0.009, f.third
        ),
    ]


def _safe_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    wheel = turned(ring((0, 0, 0), y * 0.13, 0.02, f.second), 90, axis=0)
    middle = wheel._replace(vertices=wheel.vertices + _at(x * 0.1, y * 0.5, z + 0.02))
    dial = box((-x * 0.6, y * 0.62, z), (-x * 0.3, y * 0.78, z + 0.01), (150.0, 220.0, 170.0))
    bars = [
        box((x * 0.1 - a, y * 0.5 - b, z), (x * 0.1 + a, y * 0.5 + b, z + 0.025), f.second)
        for a, b in ((y * 0.13, 0.01), (0.01, y * 0.13))
    ]
    edge = [box((-x * 0.86, y * 0.1, z), (x * 0.86, y * 0.9, z + 0.006), shade(f.main, 1.2))]
    return [box((-x, 0, z - 0.04), (x, y, z), f.main), *edge, middle, dial, *bars]


def _at(x: float, y: float, z: float) -> tuple[float, float, float]:
    return (x, y, z)


def _beside(f: Form) -> list[Mesh]:
    """Return the panel of buttons of a microwave."""
    if f.style != "microwave":
        return []
    x, y, z = f.half
    left = x - f.width * 0.22
    clock = (80.0, 255.0, 120.0) if f.on else (20.0, 60.0, 30.0)
    parts = [
        box((left, 0, z - 0.05), (x, y, z), shade(f.main, 0.8)),
        box((left + 0.015, y * 0.72, z), (x - 0.015, y * 0.88, z + 0.003), clock, glow=f.on),
    ]
    for row in range(3):
        for column in range(2):
            x0 = left + 0.015 + column * f.width * 0.095
            y0 = y * (0.14 + 0.18 * row)
            parts.append(
                box((x0, y0, z), (x0 + f.width * 0.07, y0 + y * 0.11, z + 0.004), f.second)
            )
    return parts


def drawer(f: Form) -> list[Mesh]:
    """Return a drawer: closed a front, open a tray that has slid out."""
    x, y, z = f.half
    front = [
        box((-x, 0, z - WALL_M), (x, y, z - 0.004), f.main),
        box(
            (-x + 0.02, min(0.02, y * 0.15), z - 0.004),
            (x - 0.02, y - min(0.02, y * 0.15), z),
            shade(f.main, 1.08),
        ),
        box(
            (-min(0.07, x * 0.5), y * 0.56, z),
            (min(0.07, x * 0.5), y * 0.56 + 0.014, z + 0.022),
            f.second,
        ),
    ]
    if f.openness <= 0:
        return [
            *front,
            slab_between(f._replace(depth=f.depth - 2 * WALL_M), 0, y, shade(f.main, 0.8)),
        ]
    wall = min(0.012, x * 0.1)
    low = y * 0.8
    tray = [
        box((-x + wall, 0.0, -z), (x - wall, 0.01, z - WALL_M), f.third),
        box((-x + 0.005, 0, -z), (-x + 0.005 + wall, low, z - WALL_M), shade(f.third, 0.9)),
        box((x - wall - 0.005, 0, -z), (x - 0.005, low, z - WALL_M), shade(f.third, 0.9)),
        box((-x + wall, 0, -z), (x - wall, low, -z + wall), shade(f.third, 0.85)),
    ]
    slide = f.openness * SLIDE * f.depth
    moved = joined([*front, *tray])
    moved = moved._replace(vertices=moved.vertices + _at(0, 0, slide))
    hole = box((-x, 0.0, -z), (x, y, -z + 0.01), shade(f.third, 0.4))
    sides = [
        box((-x, 0, -z), (-x + 0.004, y, z - WALL_M), shade(f.third, 0.5)),
        box((x - 0.004, 0, -z), (x, y, z - WALL_M), shade(f.third, 0.5)),
    ]
    return [moved, hole, *sides]


def carton(f: Form) -> list[Mesh]:
    """Return a cardboard box: closed with tape, open with its flaps out."""
    x, y, z = f.half
    thick = 0.006
    if f.openness <= 0:
        return [
            slab_between(f, 0, y, f.main),
            box((-x * 0.12, y, -z), (x * 0.12, y + 0.002, z), shade(f.second, 1.25)),
            box((-x * 0.12, y * 0.7, z), (x * 0.12, y, z + 0.002), shade(f.second, 1.25)),
        ]
    a, b, top = x * 0.8, z * 0.8, y * 0.86
    parts = [
        box((-a, 0, -b), (a, thick, b), f.third),
        box((-a, 0, -b), (-a + thick, top, b), f.main),
        box((a - thick, 0, -b), (a, top, b), f.main),
        box((-a, 0, -b), (a, top, -b + thick), f.main),
        box((-a, 0, b - thick), (a, top, b), f.main),
        box((-a + thick, thick, -b + thick), (a - thick, thick * 1.5, b - thick), f.third),
    ]
    lift = y - top
    for side in (-1, 1):
        parts.append(_flap((side * a, top, -b), (side * (x - a), lift, 0), (0, 0, 2 * b), f.second))
        parts.append(_flap((-a, top, side * b), (0, lift, side * (z - b)), (2 * a, 0, 0), f.second))
    return parts


def slab_between(f: Form, y0: float, y1: float, colour: Colour) -> Mesh:
    """Return a box over the whole ground between two heights."""
    x, _, z = f.half
    return box((-x, y0, -z), (x, y1, z), colour)


def _flap(
    start: tuple[float, float, float], out: tuple[float, float, float],
    along: tuple[float, float, float], colour: Colour,
) -> Mesh:  # fmt: skip
    return sheet(start, along, out, colour)


def hamper(f: Form) -> list[Mesh]:
    """Return a basket with a lid that stands up when open."""
    x, y, z = f.half
    r = x * 0.9
    weave = [f.main if band % 2 else f.second for band in range(6)]
    profile = [(r * (0.85 + 0.15 * band / 6), y * 0.92 * band / 6) for band in range(7)]
    body = lathe(profile, weave, depth=z / x)
    inner = lathe(
        [(r * 0.95, y * 0.92), (r * 0.8, y * 0.05), (0.0, y * 0.05)], f.third, depth=z / x
    )
    lid = drum(x, 0.0, y * 0.08, f.second, depth=z / x)
    raised = lid._replace(vertices=lid.vertices + _at(0, y * 0.92, 0))
    if f.openness > 0:
        raised = turned(raised, -95 * f.openness, axis=0, about=(0, y * 0.92, -z))
    return [body, inner, raised]


def toilet(f: Form) -> list[Mesh]:
    """Return a toilet: tank, bowl, and a lid that stands up when open."""
    x, y, z = f.half
    tank = f.depth * 0.28
    level = y * 0.5
    middle = tank / 2
    reach = f.depth / 2 - middle
    bowl_x = x * 0.85
    long = (z - (-z + tank)) / 2 / bowl_x
    profile = [
        (bowl_x * 0.55, 0.0), (bowl_x * 0.5, level * 0.4), (bowl_x, level * 0.85), (bowl_x, level),
        (bowl_x * 0.72, level), (bowl_x * 0.4, level * 0.5), (0.0, level * 0.45),
    ]  # fmt: skip
    colours = [f.main, f.main, f.main, f.main, shade(f.main, 0.85), f.third]
    bowl = lathe(profile, colours, depth=long, sides=16)
    lid = drum(bowl_x, level, level + 0.03, shade(f.main, 0.96), depth=long, sides=16)
    bowl, lid = (part._replace(vertices=part.vertices + _at(0, 0, middle)) for part in (bowl, lid))
    hinge = (0.0, level, middle - reach)
    if f.openness > 0:
        lid = turned(lid, -95 * f.openness, axis=0, about=hinge)
    return [
        bowl, lid,
        box((-x, level * 0.8, -z), (x, y, -z + tank), f.main),
        box((-x * 1.0, y * 0.96, -z), (x, y, -z + tank * 1.1), shade(f.main, 0.95)),
        box((-x * 0.85, y * 0.84, -z + tank), (-x * 0.5, y * 0.89, -z + tank + 0.02), f.second),
        box((-x * 0.5, 0, -z), (x * 0.5, level * 0.8, -z + tank * 1.3), f.main),
    ]  # fmt: skip


def laptop(f: Form) -> list[Mesh]:
    """Return two slabs with a hinge at the back; closed it lies flat."""
    x, y, z = f.half
    thick = min(0.018, y * 0.2)
    opened = f.openness > 0
    deep = f.depth * (0.72 if y > f.depth * 0.4 else 1.0)
    front = z if opened else deep / 2
    back = front - deep
    base = [
        box((-x, 0, back), (x, thick, front), f.main),
        box(
            (-x * 0.88, thick, back + deep * 0.12),
            (x * 0.88, thick + 0.002, front - deep * 0.38),
            f.second,
        ),
        box(
            (-x * 0.25, thick, front - deep * 0.32),
            (x * 0.25, thick + 0.002, front - deep * 0.06),
            shade(f.main, 0.8),
        ),
    ]
    if not opened:
        lid = [box((-x, thick, back), (x, thick * 2, front), shade(f.main, 0.92))]
        mark = ball(
            (0, thick * 2, (back + front) / 2), (x * 0.1, 0.002, x * 0.1), (240.0, 240.0, 240.0)
        )
        return [base[0], *lid, mark]
    tall = min(deep, y) * 0.97
    lit = f.on and not f.broken
    screen = [
        box((-x, 0, -thick), (x, tall, 0), f.main),
        *glass(x * 0.92, tall * 0.07, tall * 0.94, 0.002, f, lit=lit),
    ]
    lean = turned(joined(screen), 82 * (1 - f.openness) - 8, axis=0)
    standing = lean._replace(vertices=lean.vertices + _at(0, thick, back + thick))
    return [*base, standing]


def glass(x: float, y0: float, y1: float, z: float, f: Form, *, lit: bool) -> list[Mesh]:
    """Return a screen at z: dark, lit with a picture, or cracked."""
    dark = (10.0, 11.0, 14.0) if not f.broken else (34.0, 36.0, 40.0)
    parts = [box((-x, y0, z - 0.002), (x, y1, z), f.third if lit else dark, glow=lit)]
    tall = y1 - y0
    if lit:
        for number, colour in enumerate(
            ((255.0, 255.0, 255.0), (255.0, 214.0, 90.0), (120.0, 220.0, 120.0))
        ):
            top = y1 - tall * (0.15 + 0.22 * number)
            wide = x * (1.2, 0.9, 1.5)[number]
            parts.append(
                box(
                    (-x * 0.85, top - tall * 0.1, z),
                    (-x * 0.85 + wide, top, z + 0.002),
                    colour,
                    glow=True,
                )
            )
    if f.broken:
        parts += cracks(x, y0, y1, z + 0.003, (215.0, 220.0, 225.0))
    return parts


def cracks(x: float, y0: float, y1: float, z: float, colour: Colour = CRACK) -> list[Mesh]:
    """Return lines that run out from where something hit a pane at z."""
    cx, cy = x * 0.15, y0 + (y1 - y0) * 0.55
    ends = (
        (-x, y0 + (y1 - y0) * 0.8), (-x * 0.9, y0), (-x * 0.2, y1), (x, y1 * 0.96 + y0 * 0.04),
        (x, y0 + (y1 - y0) * 0.25), (x * 0.35, y0), (-x, y0 + (y1 - y0) * 0.35),
    )  # fmt: skip
    wide = max(x, (y1 - y0) / 2) * 0.018 + 0.0015
    lines = [rod((cx, cy, z), (ax, ay, z), wide, colour, sides=4) for ax, ay in ends]
    for share in (0.35, 0.65):
        places = [(cx + (ax - cx) * share, cy + (ay - cy) * share) for ax, ay in ends[:4]]
        for (ax, ay), (bx, by) in itertools.pairwise(places):
            lines.append(rod((ax, ay, z), (bx, by, z), wide * 0.8, colour, sides=4))
    return lines


BUILDERS: dict[str, Builder] = {
    "case": case, "drawer": drawer, "carton": carton, "hamper": hamper, "toilet": toilet,
    "laptop": laptop,
}  # fmt: skip
