"""Build small things: vessels, bottles, plates, cutlery; plants, pillows, food and its pieces."""

from math import cos, pi, sin

import numpy as np

from karma.world.render.form import SIDES, Builder, Form, mix, shade
from karma.world.render.mesh import (
    Colour,
    Mesh,
    ball,
    box,
    drum,
    lathe,
    rod,
    sheet,
    shifted,
    turned,
)

CRISP: Colour = (96.0, 52.0, 18.0)
SEED: Colour = (84.0, 52.0, 30.0)


def fragile(build: Builder) -> Builder:
    """Return a builder that draws shards of what is broken."""
    return lambda f: shards(f) if f.broken else build(f)


def shards(f: Form) -> list[Mesh]:
    """Return what lies about when a thing has broken."""
    x, y, z = f.half
    found = []
    for number in range(9):
        angle = number * 2.39996
        far = 0.25 + 0.7 * (number / 9)
        size = min(x, z) * (0.5 - 0.03 * number) + 0.006
        colour = f.main if number % 2 else shade(f.main, 0.72)
        piece = rod((0, 0, 0), (0, max(min(y * 0.12, 0.02), 0.004), 0), size, colour, sides=3)
        piece = turned(piece, 12 + 9 * (number % 4), axis=0 if number % 2 else 2)
        piece = turned(piece, number * 53)
        found.append(shifted(piece, cos(angle) * x * far, size * 0.28, sin(angle) * z * far))
    return found


# ------------------------------------------------------------------ vessels


def _open(f: Form, radius: float, foot: float, wall: float, depth: float) -> list[Mesh]:
    """Return a cup with an inside, and what is in it."""
    y = f.height
    profile = [
        (0.0, 0.0), (foot, 0.0), ((foot + radius) / 2 * 1.02, y * 0.5), (radius, y),
        (radius - wall, y), ((foot + radius) / 2 - wall, y * 0.5), (foot - wall, y * 0.07),
        (0.0, y * 0.07),
    ]  # fmt: skip
    parts = [lathe(profile, _inside_out(f, 0.72), depth=depth, sides=16)]
    if f.filled:
        level = max(radius * 0.95 - wall, 0.004)
        parts.append(drum(level, y * 0.6, y * 0.92, f.liquid, depth=depth, sides=16))
    return parts


def _inside_out(f: Form, dark: float) -> list[Colour]:
    """Return the colours of a vessel's bands: outside, rim, inside, floor."""
    inner = shade(f.main, dark)
    return [f.main, f.main, f.main, shade(f.main, 1.12), inner, inner, shade(inner, 0.9)]


@fragile
def pot(f: Form) -> list[Mesh]:
    """Return a pot with two grips along its longer side."""
    x, y, z = f.half
    radius = min(x, z) if abs(f.width - f.depth) > 0.02 else x * 0.84
    parts = _open(f._replace(height=y * 0.96), radius, radius * 0.97, radius * 0.06, 1.0)
    low, high = (radius * 0.95, y * 0.68, -radius * 0.25), (max(x, z), y * 0.78, radius * 0.25)
    grip = box(low, high, f.second)
    for one in (turned(grip, 180), turned(grip, 0)):
        parts.append(one if f.along_x else turned(one, 90))
    return parts


@fragile
def pan(f: Form) -> list[Mesh]:
    """Return a pan with a long handle."""
    length, across = max(f.width, f.depth), min(f.width, f.depth)
    radius = across / 2 if length >= across * 1.15 else across * 0.36
    low = f._replace(height=f.height * 0.9)
    parts = _open(low, radius, radius * 0.86, radius * 0.06, 1.0)
    parts = [shifted(part, 0, 0, length / 2 - radius) for part in parts]
    start = (-across * 0.06, f.height * 0.62, -length / 2)
    end = (across * 0.06, f.height * 0.95, length / 2 - 2 * radius + 0.02)
    parts.append(box(start, end, f.second))
    return [turned(part, 90) if f.width > f.depth else part for part in parts]


def plate(f: Form) -> list[Mesh]:
    """Return a disc with a raised, coloured rim."""
    if f.broken:
        return shards(f._replace(height=0.05))
    profile = [(0, 0), (0.6, 0), (1, 1), (0.93, 1), (0.62, 0.5), (0.3, 0.45), (0, 0.45)]
    colours = [f.main, f.main, f.second, shade(f.main, 0.95), f.main, shade(f.main, 1.02)]
    return [f.at_least(0.012).lathe(profile, colours, sides=20)]


# ------------------------------------------------------------------ bottles


# ------------------------------------------------------------------ cutlery, its head in front


def knife(f: Form) -> list[Mesh]:
    """Return a knife, or the narrower one for butter."""
    f = f.at_least(0.006)._replace(width=max(f.width, 0.014))  # else too thin to be seen
    x, y, z = f.half
    share, narrow = (0.38, 1.0) if f.style == "knife" else (0.45, 0.8)
    root = -z + f.depth * share
    blade = rod((0, y * 0.5, root), (0, y * 0.5, z), 1.0, f.main, sides=4, thin=0.25)
    points = blade.vertices.copy()
    points[:, 0] *= x * narrow
    points[:, 1] = y * 0.5 + (points[:, 1] - y * 0.5) * 0.25 * y
    wide = x * narrow / 2
    handle = box((-wide, 0, -z), (wide, y, root), f.second)
    return [handle, blade._replace(vertices=points)]


# ------------------------------------------------------------------ plants and food


def plant(f: Form) -> list[Mesh]:
    """Return leaves in a pot with earth; watered, the earth is under water."""
    x, y, z = f.half
    wide = min(x, z) * 0.62
    top = y * 0.36
    profile = [(0, 0), (wide * 0.7, 0), (wide, top), (wide * 0.85, top), (wide * 0.8, top * 0.85)]
    earth = f.liquid if f.filled else (74.0, 50.0, 32.0)
    parts = [lathe(profile, f.second), drum(wide * 0.84, top * 0.8, top * 0.92, earth)]
    for leaf in range(11):
        angle = leaf * 2.39996
        far = 0.35 + 0.6 * ((leaf * 7) % 11) / 11
        high = y * (0.58 + 0.4 * ((leaf * 5) % 11) / 11)
        end = (sin(angle) * x * far * 0.85, high * 0.96, cos(angle) * z * far * 0.85)
        colour = f.main if leaf % 2 else f.third
        parts.append(rod((0, top * 0.8, 0), end, wide * 0.03 + 0.002, shade(f.main, 0.7), sides=3))
        parts.append(ball(end, f.at(0.2, 0.045, 0.2), colour, sides=6, rings=4))
    return parts


def pillow(f: Form) -> list[Mesh]:
    """Return a cushion, thick in the middle."""
    x, y, z = f.half
    top = sheet((-x, y * 0.45, z), (2 * x, 0, 0), (0, 0, -2 * z), f.main, cells=(8, 8))
    points = top.vertices.copy()
    across = (1 - (points[:, 0] / x) ** 2) * (1 - (points[:, 2] / z) ** 2)
    points[:, 1] += y * 0.55 * across**0.5
    under = points.copy()
    under[:, 1] = y * 0.9 - under[:, 1]
    seam = f.box((-0.99, 0.42, -0.99), (0.99, 0.48, 0.99), shade(f.main, 0.7))
    return [top._replace(vertices=points), top._replace(vertices=under), seam]


# ------------------------------------------------------------------ fruit, bread, eggs


def _body(f: Form) -> Mesh:
    skin = mix(f.main, CRISP, 0.7) if f.cooked else f.main
    return f.ball((0, 0.5, 0), (1, 0.5, 1), skin, sides=16, rings=9)


def egg(f: Form) -> list[Mesh]:
    """Return an egg, narrower above."""
    body = _body(f)
    points = body.vertices.copy()
    narrow = 1 - 0.3 * np.clip(points[:, 1] / f.height, 0, 1) ** 2
    points[:, 0] *= narrow
    points[:, 2] *= narrow
    return [body._replace(vertices=points)]


# ------------------------------------------------------------------ pieces


def _skin_and_flesh(f: Form) -> tuple[Colour, Colour]:
    if not f.cooked:
        return f.main, f.second
    return mix(f.main, (40.0, 22.0, 10.0), 0.6), mix(f.second, CRISP, 0.6)


def round_slice(f: Form) -> list[Mesh]:
    """Return a disc of flesh with a rim of skin across its thinnest side, perhaps with seeds."""
    skin, flesh = _skin_and_flesh(f)
    sides = (f.width, f.height, f.depth)
    thin = int(np.argmin(sides))
    a, b = (side / 2 for axis, side in enumerate(sides) if axis != thin)
    t = sides[thin] * 0.86
    profile = [(0.0, 0.0), (a * 0.86, 0.0), (a, 0.0), (a, t), (a * 0.86, t), (0.0, t)]
    parts = [lathe(profile, [flesh, skin, skin, skin, flesh], depth=b / a)]
    if f.style == "seeds":
        seed = drum(a * 0.17, 0, t * 1.02, f.third, sides=6)
        angles = [i * pi / 3 for i in range(6)]
        parts += [shifted(seed, cos(one) * a * 0.5, 0, sin(one) * b * 0.5) for one in angles]
    if thin == 1:
        return parts
    axis = 2 if thin == 0 else 0
    upright = [turned(shifted(part, 0, -sides[thin] / 2, 0), 90, axis=axis) for part in parts]
    return [shifted(part, 0, f.height / 2, 0) for part in upright]


def wedge(f: Form) -> list[Mesh]:
    """Return half a round of flesh, skin below, two seeds on top."""
    skin, flesh = _skin_and_flesh(f)
    rind = f.ball((0, 0.8, 0), (1, 0.8, 1), skin, sides=12, rings=9)
    keep = rind.vertices.copy()
    keep[:, 1] = np.minimum(keep[:, 1], f.height * 0.8)
    seeds = [f.ball((0, 1, s * 0.2), (0.1, 0.04, 0.12), SEED, sides=6, rings=4) for s in SIDES]
    cut = f.lathe([(0, 0.78), (0.93, 0.78), (0.93, 1), (0, 1)], flesh, sides=12)
    return [rind._replace(vertices=keep), cut, *seeds]


def bread_slice(f: Form) -> list[Mesh]:
    """Return a slice of bread, lying or standing."""
    crust, crumb = _skin_and_flesh(f)
    if f.height <= min(f.width, f.depth):
        inner = f.box((-0.86, 0.02, -0.86), (0.86, 1.01, 0.86), crumb)
        return [f.box((-1, 0, -1), (1, 0.97, 1), crust), inner]
    x, z = (0.84, 1.02) if f.depth <= f.width else (1.02, 0.84)
    return [f.box((-1, 0, -1), (1, 1, 1), crust), f.box((-x, 0.08, -z), (x, 0.9, z), crumb)]


def loaf(f: Form) -> list[Mesh]:
    """Return a bread with a rounded top and cuts across."""
    parts = [
        f.box((-0.88, 0, -0.92), (0.88, 0.52, 0.92), f.main),
        f.ball((0, 0.5, 0), (1, 0.5, 1), shade(f.main, 1.08), sides=16, rings=9),
    ]
    for place, top in ((-0.45, 0.9), (0.0, 0.95), (0.45, 0.9)):
        middle, half = (place, top, 0.0), (0.05, 0.07, 0.55)
        if f.depth >= f.width:
            middle, half = (0.0, top, place), (0.55, 0.07, 0.05)
        parts.append(f.ball(middle, half, f.second, sides=8, rings=4))
    return parts
