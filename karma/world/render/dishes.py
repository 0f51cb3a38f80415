"""Build vessels, bottles, plates and cutlery."""

from math import cos, sin

from karma.world.render.form import Builder, Form, mix, shade
from karma.world.render.mesh import Colour, Mesh, bent, box, drum, lathe, rod, shifted, turned


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
def mug(f: Form) -> list[Mesh]:
    """Return a cup with a handle at its right."""
    room = min(f.width, f.depth * 1.25)
    radius = min(room * 0.4, f.depth / 2)
    y = f.height
    cup = _open(f, radius, radius * 0.9, radius * 0.12, min(1.0, f.depth / 2 / radius))
    x0, x1 = radius * 0.9, max(f.width - radius, radius * 1.3)
    arch = [(x0, y * 0.78, 0), (x1, y * 0.7, 0), (x1, y * 0.32, 0), (x0, y * 0.22, 0)]
    grip = bent(arch, y * 0.065, shade(f.main, 0.85))
    return [shifted(part, f.width / 2 - x1, 0, 0) for part in [*cup, *grip]]


@fragile
def cup(f: Form) -> list[Mesh]:
    """Return a cup without a handle."""
    x, _, z = f.half
    return _open(f, x, x * 0.68, x * 0.09, z / x)


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


@fragile
def can(f: Form) -> list[Mesh]:
    """Return a garbage can with a rim and a band."""
    x, _, z = f.half
    rim = f.lathe([(0.9, 0.95), (1, 0.95), (1, 1), (0.9, 1)], f.second, sides=16)
    band = f.lathe([(0.9, 0.6), (0.93, 0.66)], f.second, sides=16)
    return [*_open(f, x, x * 0.78, x * 0.06, z / x), rim, band]


def plate(f: Form) -> list[Mesh]:
    """Return a disc with a raised, coloured rim."""
    if f.broken:
        return shards(f._replace(height=0.05))
    profile = [(0, 0), (0.6, 0), (1, 1), (0.93, 1), (0.62, 0.5), (0.3, 0.45), (0, 0.45)]
    colours = [f.main, f.main, f.second, shade(f.main, 0.95), f.main, shade(f.main, 1.02)]
    return [f.at_least(0.012).lathe(profile, colours, sides=20)]


# ------------------------------------------------------------------ bottles


@fragile
def flask(f: Form) -> list[Mesh]:
    """Return a bottle with a neck and a label."""
    wine = f.style == "wine"
    low = 0.6 if wine else 0.66
    profile = [(0, 0), (1, 0), (1, low), (0.32, low + 0.16), (0.32, 0.94), (0.32, 1), (0, 1)]
    glass = mix(f.main, f.liquid, 0.55) if f.filled and not wine else f.main
    label = f.third if not f.filled or wine else f.liquid
    parts = [
        f.lathe(profile, [glass, glass, glass, glass, f.second, f.second]),
        f.lathe([(1.01, 0.18), (1.01, 0.46)], label),
    ]
    return parts + ([f.lathe([(1.015, 0.49), (1.015, 0.58)], f.liquid)] if f.filled else [])


# ------------------------------------------------------------------ cutlery, its head in front


def _cutlery(build: Builder) -> Builder:
    """Return a builder of what would be too thin to be seen."""
    return lambda f: build(f.at_least(0.006)._replace(width=max(f.width, 0.014)))


def _handle(f: Form, share: float, wide: float) -> Mesh:
    z = f.depth / 2
    return box((-wide / 2, 0, -z), (wide / 2, f.height, -z + f.depth * share), f.second)


@_cutlery
def knife(f: Form) -> list[Mesh]:
    """Return a knife, or the narrower one for butter."""
    x, y, z = f.half
    share, narrow = (0.38, 1.0) if f.style == "knife" else (0.45, 0.8)
    root = -z + f.depth * share
    blade = rod((0, y * 0.5, root), (0, y * 0.5, z), 1.0, f.main, sides=4, thin=0.25)
    points = blade.vertices.copy()
    points[:, 0] *= x * narrow
    points[:, 1] = y * 0.5 + (points[:, 1] - y * 0.5) * 0.25 * y
    return [_handle(f, share, x * narrow), blade._replace(vertices=points)]


# ------------------------------------------------------------------ rolls
