"""Build vessels, bottles, plates and cutlery."""

from math import cos, sin

from karma.world.render.form import Builder, Form, mix, shade
from karma.world.render.mesh import (
    GLASS,
    Mesh,
    bent,
    box,
    drum,
    lathe,
    ring,
    rod,
    shifted,
    turned,
)


def vessel(f: Form) -> list[Mesh]:
    """Return an open vessel: mug, cup, bowl, pot, pan, garbage can."""
    if f.broken:
        return shards(f)
    return {
        "mug": _mug, "cup": _cup, "bowl": _bowl, "pot": _pot, "pan": _pan, "can": _can
    }[f.style](f)  # fmt: skip


def _open(f: Form, radius: float, foot: float, wall: float, depth: float) -> list[Mesh]:
    """Return a cup with an inside, and what is in it."""
    y = f.height
    inner = shade(f.main, 0.72)
    profile = [
        (0.0, 0.0), (foot, 0.0), ((foot + radius) / 2 * 1.02, y * 0.5), (radius, y),
        (radius - wall, y), ((foot + radius) / 2 - wall, y * 0.5), (foot - wall, y * 0.07),
        (0.0, y * 0.07),
    ]  # fmt: skip
    colours = [f.main, f.main, f.main, shade(f.main, 1.12), inner, inner, shade(inner, 0.9)]
    parts = [lathe(profile, colours, depth=depth, sides=16)]
    if f.filled:
        level = max(radius * 0.95 - wall, 0.004)
        parts.append(drum(level, y * 0.6, y * 0.92, f.liquid, depth=depth, sides=16))
    return parts


def _mug(f: Form) -> list[Mesh]:
    room = min(f.width, f.depth * 1.25)
    radius = min(room * 0.4, f.depth / 2)
    cup = _open(f, radius, radius * 0.9, radius * 0.12, min(1.0, f.depth / 2 / radius))
    x0, x1 = radius * 0.9, max(f.width - radius, radius * 1.3)
    side = shade(f.main, 0.85)
    grip = bent(
        [(x0, f.height * 0.78, 0), (x1, f.height * 0.7, 0), (x1, f.height * 0.32, 0),
         (x0, f.height * 0.22, 0)],
        f.height * 0.065, side,
    )  # fmt: skip
    shift = f.width / 2 - x1
    return [shifted(part, shift, 0, 0) for part in [*cup, *grip]]


def _cup(f: Form) -> list[Mesh]:
    x, _, z = f.half
    return _open(f, x, x * 0.68, x * 0.09, z / x)


def _bowl(f: Form) -> list[Mesh]:
    x, y, z = f.half
    inner = shade(f.main, 0.75)
    profile = [
        (0.0, 0.0), (x * 0.4, 0.0), (x * 0.78, y * 0.4), (x, y), (x * 0.93, y),
        (x * 0.7, y * 0.45), (x * 0.35, y * 0.1), (0.0, y * 0.1),
    ]  # fmt: skip
    colours = [f.main, f.main, f.main, shade(f.main, 1.12), inner, inner, shade(inner, 0.9)]
    parts = [lathe(profile, colours, depth=z / x, sides=18)]
    if f.filled:
        parts.append(drum(x * 0.86, y * 0.5, y * 0.8, f.liquid, depth=z / x, sides=18))
    return parts


def _pot(f: Form) -> list[Mesh]:
    x, y, z = f.half
    across_x = f.width >= f.depth
    radius = min(x, z) if abs(f.width - f.depth) > 0.02 else x * 0.84
    parts = _open(f._replace(height=y * 0.96), radius, radius * 0.97, radius * 0.06, 1.0)
    reach = max(x, z)
    for side in (-1, 1):
        low, high = radius * 0.95, reach
        grip = box((low, y * 0.68, -radius * 0.25), (high, y * 0.78, radius * 0.25), f.second)
        grip = turned(grip, 0 if side > 0 else 180)
        parts.append(grip if across_x else turned(grip, 90))
    return parts


def _pan(f: Form) -> list[Mesh]:
    long_x = f.width > f.depth
    length, across = max(f.width, f.depth), min(f.width, f.depth)
    radius = across / 2
    if length < across * 1.15:
        radius = across * 0.36
    low = f._replace(height=f.height * 0.9)
    parts = _open(low, radius, radius * 0.86, radius * 0.06, 1.0)
    parts = [shifted(part, 0, 0, length / 2 - radius) for part in parts]
    tail = length / 2 - 2 * radius
    handle = box(
        (-across * 0.06, f.height * 0.62, -length / 2),
        (across * 0.06, f.height * 0.95, tail + 0.02),
        f.second,
    )
    return [turned(part, 90) if long_x else part for part in [*parts, handle]]


def _can(f: Form) -> list[Mesh]:
    x, y, z = f.half
    parts = _open(f, x, x * 0.78, x * 0.06, z / x)
    rim = lathe(
        [(x * 0.9, y * 0.95), (x, y * 0.95), (x, y), (x * 0.9, y)], f.second, depth=z / x, sides=16
    )
    band = lathe([(x * 0.9, y * 0.6), (x * 0.93, y * 0.66)], f.second, depth=z / x, sides=16)
    return [*parts, rim, band]


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


def plate(f: Form) -> list[Mesh]:
    """Return a disc with a raised, coloured rim."""
    if f.broken:
        return shards(f._replace(height=0.05))
    x, y, z = f.half
    y = max(y, 0.012)
    profile = [
        (0.0, 0.0), (x * 0.6, 0.0), (x, y), (x * 0.93, y), (x * 0.62, y * 0.5), (x * 0.3, y * 0.45),
        (0.0, y * 0.45),
    ]  # fmt: skip
    colours = [f.main, f.main, f.second, shade(f.main, 0.95), f.main, shade(f.main, 1.02)]
    return [lathe(profile, colours, depth=z / x, sides=20)]


def kettle(f: Form) -> list[Mesh]:
    """Return a kettle or a watering can: body, spout, handle, lid."""
    x, y, z = f.half
    along_x = f.width >= f.depth
    length, across = (x, z) if along_x else (z, x)
    watering = f.style == "watering"
    radius = min(across, length * (0.62 if watering else 0.8))
    back = -length + radius
    top = y * (0.62 if watering else 0.7)
    body = lathe(
        [(0.0, 0.0), (radius, 0.0), (radius * (1.0 if watering else 0.72), top), (0.0, top)], f.main
    )
    parts = [shifted(body, back, 0, 0)]
    tip = (length, y * (0.92 if watering else 0.62), 0.0)
    root = (back + radius * 0.75, y * (0.15 if watering else 0.3), 0.0)
    parts.append(rod(root, tip, radius * 0.16, f.main, thin=radius * (0.3 if watering else 0.12)))
    arch = [
        (back - radius * 0.75, top * 0.9, 0), (back - radius * 0.6, y * 0.97, 0),
        (back + radius * 0.6, y * 0.97, 0), (back + radius * 0.6, top * 0.9, 0),
    ]  # fmt: skip
    parts += bent([(float(a), float(b), float(c)) for a, b, c in arch], y * 0.035, f.second)
    if f.openness <= 0 and not watering:
        parts += [shifted(drum(radius * 0.5, top, top + y * 0.06, f.second), back, 0, 0)]
    elif not watering:
        lid = turned(drum(radius * 0.5, 0, y * 0.05, f.second), 75, axis=2)
        parts += [shifted(lid, back - radius * 0.6, top + y * 0.14, 0)]
        parts += [shifted(drum(radius * 0.5, top, top + 0.002, (15.0, 15.0, 18.0)), back, 0, 0)]
    if f.filled:
        parts += [shifted(drum(radius * 0.62, top, top + 0.006, f.liquid), back, 0, 0)]
    return parts if along_x else [turned(part, 90) for part in parts]


def bottle(f: Form) -> list[Mesh]:
    """Return a bottle, a shaker or a vase."""
    if f.broken:
        return shards(f)
    return {"vase": _vase, "shaker": _shaker, "pump": _pump, "spray": _spray}.get(
        f.style, _flask
    )(f)  # fmt: skip


def _flask(f: Form) -> list[Mesh]:
    x, y, z = f.half
    wine = f.style == "wine"
    shoulder = 0.6 if wine else 0.66
    neck = x * 0.32
    profile = [
        (0.0, 0.0), (x, 0.0), (x, y * shoulder), (neck, y * (shoulder + 0.16)), (neck, y * 0.94),
        (neck, y), (0.0, y),
    ]  # fmt: skip
    glass = mix(f.main, f.liquid, 0.55) if f.filled and not wine else f.main
    cap = f.second
    parts = [lathe(profile, [glass, glass, glass, glass, cap, cap], depth=z / x)]
    label = f.third if not f.filled or wine else f.liquid
    parts.append(
        lathe([(x * 1.01, y * 0.18), (x * 1.01, y * 0.46)], label, depth=z / x)
    )  # fmt: skip
    if f.filled:
        parts.append(
            lathe([(x * 1.015, y * 0.49), (x * 1.015, y * 0.58)], f.liquid, depth=z / x)
        )  # fmt: skip
    return parts


def _vase(f: Form) -> list[Mesh]:
    x, y, z = f.half
    dark = shade(f.main, 0.4)
    profile = [
        (0.0, 0.0), (x * 0.55, 0.0), (x, y * 0.4), (x * 0.8, y * 0.66), (x * 0.4, y * 0.86),
        (x * 0.62, y), (x * 0.5, y), (x * 0.3, y * 0.84), (0.0, y * 0.8),
    ]  # fmt: skip
    light = shade(f.main, 1.25)
    colours = [f.main, f.main, light, f.main, light, f.main, dark, dark]
    return [lathe(profile, colours, depth=z / x)]


def _shaker(f: Form) -> list[Mesh]:
    x, y, z = f.half
    body = lathe(
        [(0.0, 0.0), (x, 0.0), (x * 0.72, y * 0.72), (x * 0.78, y * 0.74), (x * 0.6, y), (0.0, y)],
        [f.main, f.main, f.main, f.second, f.second], depth=z / x, sides=12,
    )  # fmt: skip
    dots = [(0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3)]
    return [body] + [
        shifted(drum(x * 0.08, y, y * 1.01, (20.0, 20.0, 20.0), sides=5), a * x, 0, b * z)
        for a, b in dots
    ]


def _pump(f: Form) -> list[Mesh]:
    x, y, z = f.half
    if f.used_up:
        body = drum(x, 0.0, y * 0.68, f.main, depth=z / x, clear=GLASS)
        inside = [drum(x * 0.9, 0.0, y * 0.03, f.main, depth=z / x)]
    else:
        body = drum(x, 0.0, y * 0.68, f.main, depth=z / x)
        band = lathe([(x * 1.01, y * 0.18), (x * 1.01, y * 0.5)], f.third, depth=z / x)
        inside = [band]
    return [
        body, *inside, drum(x * 0.5, y * 0.68, y * 0.78, f.second, sides=8),
        rod((0, y * 0.78, 0), (0, y * 0.96, 0), x * 0.14, f.second, sides=6),
        box((-x * 0.2, y * 0.92, -z * 0.2), (x * 0.2, y, z), f.second),
    ]  # fmt: skip


def _spray(f: Form) -> list[Mesh]:
    x, y, z = f.half
    r = min(x, z)
    return [
        lathe([(0.0, 0.0), (r, 0.0), (r, y * 0.5), (r * 0.35, y * 0.68), (0.0, y * 0.68)], f.main,
              depth=1.0),
        lathe([(r * 1.01, y * 0.12), (r * 1.01, y * 0.42)], f.third),
        rod((0, y * 0.68, 0), (0, y * 0.8, 0), r * 0.3, f.second),
        box((-r * 0.3, y * 0.8, -z * 0.6), (r * 0.3, y, z * 0.85), f.second),
        box((-r * 0.12, y * 0.62, z * 0.35), (r * 0.12, y * 0.82, z * 0.6), f.third),
    ]  # fmt: skip


# ------------------------------------------------------------------ cutlery


def cutlery(f: Form) -> list[Mesh]:
    """Return a knife, fork, spoon, ladle or spatula along z, its head in front."""
    y = max(f.height, 0.006)
    wide = max(f.width, 0.014)
    f = f._replace(height=y, width=wide)
    return {
        "knife": _knife, "butter": _knife, "fork": _fork, "spoon": _spoon, "ladle": _ladle,
        "spatula": _spatula,
    }[f.style](f)  # fmt: skip


def _handle(f: Form, share: float, wide: float) -> Mesh:
    z = f.depth / 2
    return box((-wide / 2, 0, -z), (wide / 2, f.height, -z + f.depth * share), f.second)


def _knife(f: Form) -> list[Mesh]:
    x, y, z = f.half
    share = 0.38 if f.style == "knife" else 0.45
    root = -z + f.depth * share
    blade = rod((0, y * 0.5, root), (0, y * 0.5, z), 1.0, f.main, sides=4, thin=0.25)
    points = blade.vertices.copy()
    points[:, 0] *= x if f.style == "knife" else x * 0.8
    points[:, 1] = y * 0.5 + (points[:, 1] - y * 0.5) * 0.25 * y
    return [
        _handle(f, share, x * (1.0 if f.style == "knife" else 0.8)),
        blade._replace(vertices=points),
    ]


def _fork(f: Form) -> list[Mesh]:
    x, y, z = f.half
    neck = z - f.depth * 0.32
    parts = [_handle(f, 0.7, x * 0.7), box((-x, 0, neck), (x, y, neck + f.depth * 0.1), f.main)]
    for tine in range(4):
        at = -x + (tine + 0.5) * x / 2
        parts.append(box((at - x * 0.14, 0, neck), (at + x * 0.14, y, z), f.main))
    return parts


def _spoon(f: Form) -> list[Mesh]:
    x, y, z = f.half
    long = f.depth * 0.16
    bowl = lathe(
        [(0.0, 0.0), (x * 0.7, 0.0), (x, y), (x * 0.8, y), (0.0, y * 0.3)],
        [f.main, f.main, f.main, shade(f.main, 0.7)], depth=long / x,
    )  # fmt: skip
    return [_handle(f, 0.72, x * 0.6), shifted(bowl, 0, 0, z - long)]


def _ladle(f: Form) -> list[Mesh]:
    x, y, z = f.half
    bowl = lathe(
        [(0.0, 0.0), (x * 0.6, 0.0), (x, y), (x * 0.85, y), (x * 0.5, y * 0.3), (0.0, y * 0.3)],
        [f.main, f.main, f.main, shade(f.main, 0.5), shade(f.main, 0.5)],
    )  # fmt: skip
    stick = rod((0, y * 0.92, -z), (0, y * 0.85, z - x * 1.2), max(x * 0.14, 0.005), f.second)
    return [shifted(bowl, 0, 0, z - x), stick]


def _spatula(f: Form) -> list[Mesh]:
    x, y, z = f.half
    low = min(y, 0.02)
    head = z - f.depth * 0.3
    parts = [
        box((-x * 0.25, y * 0.4, -z), (x * 0.25, y, -z + f.depth * 0.4), f.second),
        rod((0, y * 0.7, -z + f.depth * 0.4), (0, low * 0.5, head), x * 0.13, f.main, sides=6),
    ]
    for bar in (-0.8, -0.27, 0.27, 0.8):
        parts.append(box((bar * x - x * 0.2, 0, head), (bar * x + x * 0.2, low * 0.6, z), f.main))
    parts.append(box((-x, 0, z - f.depth * 0.03), (x, low * 0.6, z), f.main))
    return parts


# ------------------------------------------------------------------ rolls


def roll(f: Form) -> list[Mesh]:
    """Return a roll of paper or foil; used up, only its core is left."""
    x, y, z = f.half
    if f.style == "lying":
        return [rod((0, y / 2, -z), (0, y / 2, z), min(x, y / 2), f.main, sides=12)] + [
            rod((0, y / 2, side * z), (0, y / 2, side * z * 1.01), min(x, y / 2) * 0.4, f.second)
            for side in (-1, 1)
        ]
    core = min(x, z) * 0.36
    hole = lathe([(core, 0), (core, y), (core * 0.8, y), (core * 0.8, 0)],
                 [f.second, f.second, shade(f.second, 0.5)])  # fmt: skip
    if f.used_up:
        return [hole]
    paper = lathe(
        [(core, 0.0), (x, 0.0), (x, y), (core, y)], [f.main, f.main, shade(f.main, 0.93)],
        depth=z / x, sides=16,
    )  # fmt: skip
    tail = box((x * 0.9, y * 0.05, z * 0.0), (x * 1.0, y, z * 0.9), shade(f.main, 0.97))
    line = ring((0, y * 1.002, 0), x * 0.7, x * 0.05, shade(f.main, 0.8))
    return [paper, hole, line, *([tail] if f.style == "standing" else [])]


BUILDERS: dict[str, Builder] = {
    "vessel": vessel, "plate": plate, "kettle": kettle, "bottle": bottle, "cutlery": cutlery,
    "roll": roll,
}  # fmt: skip
