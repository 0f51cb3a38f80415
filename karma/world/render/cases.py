"""Build drawers, laptops, screens and cracks."""

import itertools

import numpy as np

from karma.world.render.form import CRACK, Form, shade
from karma.world.render.mesh import Colour, Mesh, ball, box, joined, rod, turned

WALL_M = 0.018
SLIDE = 0.7  # of a drawer's depth, fully open


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


def _moved(part: Mesh, x: float, y: float, z: float) -> Mesh:
    """Return the part moved in double precision: its pixels show the difference to `shifted`."""
    return part._replace(vertices=np.add(part.vertices, (x, y, z)))


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
