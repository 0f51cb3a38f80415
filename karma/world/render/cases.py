"""Build furniture with doors and drawers: closed it is solid in front, open one sees into it."""

import itertools

import numpy as np

from karma.world.render.form import CRACK, Form, shade
from karma.world.render.mesh import Colour, Mesh, ball, box, drum, joined, lathe, ring, rod, turned

WALL_M = 0.018
SWING_DEG = 100.0
SLIDE = 0.7  # of a drawer's depth, fully open
_PANEL = 0.24  # of a microwave's width, at the right of its door


def case(f: Form) -> list[Mesh]:
    """Return a cabinet, fridge, microwave or safe: five walls and a door hinged on the left."""
    x, _y, z = f.half
    fronts = {"fridge": _fridge_door, "microwave": _oven_door, "safe": _safe_door}
    wall = min(WALL_M * (2.5 if f.style in fronts else 1.0), x * 0.2)
    door = joined(fronts.get(f.style, _cabinet_door)(f))
    if f.openness > 0:
        door = turned(door, -SWING_DEG * f.openness, about=(-x, 0, z))
    return [*_hollow(f, wall), *_inside(f, wall), door, *_beside(f)]


def _hollow(f: Form, wall: float) -> list[Mesh]:
    x, y, z = f.half
    x1 = x - f.width * _PANEL if f.style == "microwave" else x
    front, out, colour = z - wall, f.main, f.third
    a, b = wall + 0.001, wall + 0.003  # the inner faces, a millimetre before the walls
    return [
        box((-x, 0, -z), (-x + wall, y, front), out),
        box((x1 - wall, 0, -z), (x, y, front), out),
        box((-x, 0, -z), (x, wall, front), out),
        box((-x, y - wall, -z), (x, y, front), out),
        box((-x, 0, -z), (x, y, -z + wall), out),
        box((-x + a, a, -z + a), (x1 - a, y - a, -z + b), shade(colour, 0.9)),
        box((-x + a, a, -z + a), (-x + b, y - a, front), colour),
        box((x1 - b, a, -z + a), (x1 - a, y - a, front), colour),
        box((-x + a, a, -z + a), (x1 - a, b, front), shade(colour, 0.95)),
        box((-x + a, y - b, -z + a), (x1 - a, y - a, front), colour),
    ]


def _inside(f: Form, wall: float) -> list[Mesh]:
    x, y, z = f.half
    if f.style == "fridge":
        left, right, back, front = -x + wall, x - wall, -z + wall, -z + f.depth * 0.3
        levels = (y * 0.25, y * 0.5, y * 0.75)
        blue = (170.0, 200.0, 215.0)
        return [box((left, low, back), (right, low + 0.008, front), blue) for low in levels]
    if f.style == "microwave":
        turntable = drum(min(x * 0.6, z * 0.75), wall + 0.003, wall + 0.009, (190.0, 205.0, 210.0))
        low, high = (-x * 0.5, y - wall - 0.012, -z * 0.3), (x * 0.1, y - wall - 0.004, z * 0.3)
        lamp = box(low, high, (255.0, 225.0, 120.0), glow=True)
        return [turntable, lamp] if f.on else [turntable]
    return []


def _cabinet_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    edge = min(0.05, x * 0.3, y * 0.2)
    return [
        f.pane(min(0.006, x * 0.05), z - WALL_M, z - 0.004, f.main),
        f.pane(edge, z - 0.004, z - 0.002, shade(f.main, 0.86)),
        f.pane(edge * 1.4, z - 0.002, z, shade(f.main, 1.06)),
        box((x - edge * 0.8, y * 0.42, z), (x - edge * 0.5, y * 0.58, z + 0.02), f.second),
    ]


def _fridge_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    split, bar = y * 0.64, x - 0.07
    parts = []
    for low, high in ((0.02, split), (split + 0.012, y)):
        middle, reach = (low + high) / 2, (high - low) * 0.28
        start, end = (bar, middle - reach, z + 0.03), (bar, middle + reach, z + 0.03)
        parts += [box((-x, low, z - 0.05), (x, high, z), f.main), rod(start, end, 0.014, f.second)]
    inner = shade(f.third, 0.95)
    return [
        *parts,
        box((-x, split, z - 0.05), (x, split + 0.012, z - 0.01), f.second),
        box((-x + 0.03, 0.08, z - 0.062), (x - 0.03, y * 0.96, z - 0.05), inner),
    ]


def _oven_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    right = x - f.width * _PANEL
    pane = (255.0, 200.0, 90.0) if f.on else f.second
    left, inner, bar = -x + 0.03, right - 0.05, right - 0.025
    bands = [
        box((left, y * level, z), (inner, y * level + 0.006, z + 0.003), f.second)
        for level in (0.3, 0.45, 0.6, 0.75)
    ]
    return [
        box((-x, 0, z - 0.04), (right, y, z), f.main),
        box((left, y * 0.16, z - 0.001), (inner, y * 0.84, z + 0.002), pane, glow=f.on),
        *bands,
        rod((bar, y * 0.15, z + 0.02), (bar, y * 0.85, z + 0.02), 0.009, f.third),
    ]


def _safe_door(f: Form) -> list[Mesh]:
    x, y, z = f.half
    wheel = turned(ring((0, 0, 0), y * 0.13, 0.02, f.second), 90, axis=0)
    middle_x, middle_y = x * 0.1, y * 0.5
    return [
        box((-x, 0, z - 0.04), (x, y, z), f.main),
        f.in_front((-0.86, 0.1), (0.86, 0.9), shade(f.main, 1.2), 0.006),
        _moved(wheel, middle_x, middle_y, z + 0.02),
        f.in_front((-0.6, 0.62), (-0.3, 0.78), (150.0, 220.0, 170.0), 0.01),
        *[
            box((middle_x - a, middle_y - b, z), (middle_x + a, middle_y + b, z + 0.025), f.second)
            for a, b in ((y * 0.13, 0.01), (0.01, y * 0.13))
        ],
    ]


def _moved(part: Mesh, x: float, y: float, z: float) -> Mesh:
    """Return the part moved, in double precision: its pixels show the difference to `shifted`."""
    return part._replace(vertices=np.add(part.vertices, (x, y, z)))


def _beside(f: Form) -> list[Mesh]:
    """Return the panel of buttons of a microwave."""
    if f.style != "microwave":
        return []
    x, y, z = f.half
    left = x - f.width * 0.22
    clock = (80.0, 255.0, 120.0) if f.on else (20.0, 60.0, 30.0)
    wide, tall = f.width * 0.07, y * 0.11
    columns = [left + 0.015 + column * f.width * 0.095 for column in range(2)]
    rows = [y * (0.14 + 0.18 * row) for row in range(3)]
    return [
        box((left, 0, z - 0.05), (x, y, z), shade(f.main, 0.8)),
        box((left + 0.015, y * 0.72, z), (x - 0.015, y * 0.88, z + 0.003), clock, glow=f.on),
        *[box((a, b, z), (a + wide, b + tall, z + 0.004), f.second) for b in rows for a in columns],
    ]


def drawer(f: Form) -> list[Mesh]:
    """Return a drawer: closed a front, open a tray that has slid out."""
    x, y, z = f.half
    edge, wide, back = min(0.02, y * 0.15), min(0.07, x * 0.5), z - WALL_M
    front = [
        box((-x, 0, back), (x, y, z - 0.004), f.main),
        box((-x + 0.02, edge, z - 0.004), (x - 0.02, y - edge, z), shade(f.main, 1.08)),
        box((-wide, y * 0.56, z), (wide, y * 0.56 + 0.014, z + 0.022), f.second),
    ]
    if f.openness <= 0:
        body = f._replace(depth=f.depth - 2 * WALL_M)
        return [*front, body.box((-1, 0, -1), (1, 1, 1), shade(f.main, 0.8))]
    wall, low = min(0.012, x * 0.1), y * 0.8
    tray = [
        box((-x + wall, 0.0, -z), (x - wall, 0.01, back), f.third),
        box((-x + 0.005, 0, -z), (-x + 0.005 + wall, low, back), shade(f.third, 0.9)),
        box((x - wall - 0.005, 0, -z), (x - 0.005, low, back), shade(f.third, 0.9)),
        box((-x + wall, 0, -z), (x - wall, low, -z + wall), shade(f.third, 0.85)),
    ]
    return [
        _moved(joined([*front, *tray]), 0, 0, f.openness * SLIDE * f.depth),
        box((-x, 0.0, -z), (x, y, -z + 0.01), shade(f.third, 0.4)),
        box((-x, 0, -z), (-x + 0.004, y, back), shade(f.third, 0.5)),
        box((x - 0.004, 0, -z), (x, y, back), shade(f.third, 0.5)),
    ]


def hamper(f: Form) -> list[Mesh]:
    """Return a basket with a lid that stands up when open."""
    x, y, z = f.half
    r, top = x * 0.9, y * 0.92
    weave = [f.main if band % 2 else f.second for band in range(6)]
    profile = [(r * (0.85 + 0.15 * band / 6), top * band / 6) for band in range(7)]
    inner = [(r * 0.95, top), (r * 0.8, y * 0.05), (0.0, y * 0.05)]
    lid = _moved(f.lathe([(0, 0), (1, 0), (1, 0.08), (0, 0.08)], f.second), 0, top, 0)
    if f.openness > 0:
        lid = turned(lid, -95 * f.openness, axis=0, about=(0, top, -z))
    return [lathe(profile, weave, depth=z / x), lathe(inner, f.third, depth=z / x), lid]


def toilet(f: Form) -> list[Mesh]:
    """Return a toilet: tank, bowl, and a lid that stands up when open."""
    x, y, z = f.half
    tank = f.depth * 0.28
    level = y * 0.5
    middle = tank / 2
    bowl_x = x * 0.85
    long = (z - (-z + tank)) / 2 / bowl_x
    profile = [
        (bowl_x * 0.55, 0.0), (bowl_x * 0.5, level * 0.4), (bowl_x, level * 0.85), (bowl_x, level),
        (bowl_x * 0.72, level), (bowl_x * 0.4, level * 0.5), (0.0, level * 0.45),
    ]  # fmt: skip
    colours = [f.main, f.main, f.main, f.main, shade(f.main, 0.85), f.third]
    lid = drum(bowl_x, level, level + 0.03, shade(f.main, 0.96), depth=long, sides=16)
    lid = _moved(lid, 0, 0, middle)
    if f.openness > 0:
        hinge = (0.0, level, middle - (f.depth / 2 - middle))
        lid = turned(lid, -95 * f.openness, axis=0, about=hinge)
    back = -z + tank
    return [
        _moved(lathe(profile, colours, depth=long, sides=16), 0, 0, middle),
        lid,
        box((-x, level * 0.8, -z), (x, y, back), f.main),
        box((-x, y * 0.96, -z), (x, y, -z + tank * 1.1), shade(f.main, 0.95)),
        box((-x * 0.85, y * 0.84, back), (-x * 0.5, y * 0.89, back + 0.02), f.second),
        box((-x * 0.5, 0, -z), (x * 0.5, level * 0.8, -z + tank * 1.3), f.main),
    ]


def laptop(f: Form) -> list[Mesh]:
    """Return two slabs with a hinge at the back; closed it lies flat."""
    x, y, z = f.half
    thick = min(0.018, y * 0.2)
    opened = f.openness > 0
    deep = f.depth * (0.72 if y > f.depth * 0.4 else 1.0)
    front = z if opened else deep / 2
    back = front - deep
    base = box((-x, 0, back), (x, thick, front), f.main)
    if not opened:
        white, middle = (240.0, 240.0, 240.0), (back + front) / 2
        lid = box((-x, thick, back), (x, thick * 2, front), shade(f.main, 0.92))
        return [base, lid, ball((0, thick * 2, middle), (x * 0.1, 0.002, x * 0.1), white)]
    keys = (-x * 0.88, thick, back + deep * 0.12), (x * 0.88, thick + 0.002, front - deep * 0.38)
    pad = (-x * 0.25, thick, front - deep * 0.32), (x * 0.25, thick + 0.002, front - deep * 0.06)
    tall = min(deep, y) * 0.97
    screen = [
        box((-x, 0, -thick), (x, tall, 0), f.main),
        *glass(x * 0.92, tall * 0.07, tall * 0.94, 0.002, f),
    ]
    lean = turned(joined(screen), 82 * (1 - f.openness) - 8, axis=0)
    standing = _moved(lean, 0, thick, back + thick)
    return [base, box(*keys, f.second), box(*pad, shade(f.main, 0.8)), standing]


def glass(x: float, y0: float, y1: float, z: float, f: Form) -> list[Mesh]:
    """Return a screen at z: dark, lit with a picture, or cracked."""
    lit = f.on and not f.broken
    dark = (10.0, 11.0, 14.0) if not f.broken else (34.0, 36.0, 40.0)
    parts = [box((-x, y0, z - 0.002), (x, y1, z), f.third if lit else dark, glow=lit)]
    tall, left = y1 - y0, -x * 0.85
    lines = (
        (1.2, (255.0, 255.0, 255.0)), (0.9, (255.0, 214.0, 90.0)), (1.5, (120.0, 220.0, 120.0)),
    )  # fmt: skip
    for number, (wide, colour) in enumerate(lines if lit else ()):
        top = y1 - tall * (0.15 + 0.22 * number)
        line = (left, top - tall * 0.1, z), (left + x * wide, top, z + 0.002)
        parts.append(box(*line, colour, glow=True))
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
