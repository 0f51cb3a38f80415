"""Build fruit, bread, eggs and their pieces."""

from math import cos, pi, sin

import numpy as np

from karma.world.render.form import Builder, Form, mix, shade
from karma.world.render.mesh import Colour, Mesh, ball, box, drum, lathe, ring, rod, shifted, turned

CRISP: Colour = (96.0, 52.0, 18.0)
SEED: Colour = (84.0, 52.0, 30.0)


def fruit(f: Form) -> list[Mesh]:
    """Return an ellipsoid with what tells it from others: stem, leaves, seams."""
    x, y, z = f.half
    skin = mix(f.main, CRISP, 0.7) if f.cooked else f.main
    body = ball((0, y / 2, 0), (x, y / 2, z), skin, sides=16, rings=9)
    extra = {
        "apple": _apple, "tomato": _tomato, "lettuce": _lettuce, "basketball": _seams,
        "potato": _potato, "egg": _egg,
    }.get(f.style)  # fmt: skip
    return [body] if extra is None else extra(f, body)


def _apple(f: Form, body: Mesh) -> list[Mesh]:
    _, y, _ = f.half
    body = ball((0, y * 0.45, 0), (f.width / 2, y * 0.45, f.depth / 2), f.main, sides=16, rings=9)
    stem = rod((0, y * 0.84, 0), (y * 0.06, y, 0), y * 0.04, f.second, sides=5)
    leaf = turned(ball((0, 0, 0), (y * 0.16, y * 0.03, y * 0.08), f.third, sides=6, rings=4), 25, 2)
    return [body, stem, shifted(leaf, y * 0.16, y * 0.93, 0)]


def _tomato(f: Form, body: Mesh) -> list[Mesh]:
    y = f.height
    arms = [
        rod((0, y * 0.97, 0), (cos(a) * f.width * 0.25, y * 0.92, sin(a) * f.depth * 0.25),
            y * 0.06, f.second, sides=4, thin=0.002)
        for a in (0.3, 1.55, 2.8, 4.1, 5.3)
    ]  # fmt: skip
    return [body, *arms, drum(y * 0.08, y * 0.93, y * 1.03, f.second, sides=6)]


def _egg(f: Form, body: Mesh) -> list[Mesh]:
    points = body.vertices.copy()
    narrow = 1 - 0.3 * np.clip(points[:, 1] / f.height, 0, 1) ** 2
    points[:, 0] *= narrow
    points[:, 2] *= narrow
    return [body._replace(vertices=points)]


def _lettuce(f: Form, body: Mesh) -> list[Mesh]:
    return [
        *_leaves(f, (f.main, f.second, shade(f.main, 0.8)), 9),
        ball((0, f.height * 0.5, 0), (f.width * 0.3, f.height * 0.42, f.depth * 0.3), f.third),
    ]


def _leaves(f: Form, colours: tuple[Colour, ...], count: int) -> list[Mesh]:
    x, y, z = f.half
    found = []
    for leaf in range(count):
        angle = leaf * 2.4
        lift = 0.3 + 0.45 * leaf / count
        middle = (cos(angle) * x * 0.55, y * lift, sin(angle) * z * 0.55)
        half = (x * 0.44, y * 0.3, z * 0.44)
        found.append(ball(middle, half, colours[leaf % len(colours)], sides=8, rings=5))
    return found


def _potato(f: Form, body: Mesh) -> list[Mesh]:
    spots = [(0.5, 0.75, 0.5), (-0.55, 0.7, 0.4), (0.1, 0.93, -0.35), (0.3, 0.55, 0.85)]
    eye = f.height * 0.1
    dark = shade(f.second, 0.5 if f.cooked else 0.7)
    return [body] + [
        ball((a * f.width / 2 * 0.85, b * f.height, c * f.depth / 2 * 0.85), (eye, eye, eye), dark,
             sides=6, rings=4)
        for a, b, c in spots
    ]  # fmt: skip


def _seams(f: Form, body: Mesh) -> list[Mesh]:
    middle, size = (0.0, f.height / 2, 0.0), f.width / 2
    return [body] + [ring(middle, size, size * 0.05, f.second, axis=axis) for axis in (0, 1, 2)]


def slices(f: Form) -> list[Mesh]:
    """Return one piece: flesh with a rim of skin."""
    flesh = mix(f.second, CRISP, 0.6) if f.cooked else f.second
    skin = mix(f.main, (40.0, 22.0, 10.0), 0.6) if f.cooked else f.main
    if f.style == "bread":
        return _bread_slice(f, skin, flesh)
    if f.style == "leaves":
        low = f._replace(height=f.height * 0.9)
        return _leaves(low, (f.main, f.second, shade(f.second, 1.1)), 5)
    if f.style == "wedge":
        return _wedge(f, skin, flesh)
    return _disc(f, skin, flesh)


def _across(f: Form) -> tuple[int, float, float, float]:
    """Return the thinnest axis, the thickness, and the two half sides across it."""
    sides = (f.width, f.height, f.depth)
    thin = int(np.argmin(sides))
    others = [side / 2 for axis, side in enumerate(sides) if axis != thin]
    return thin, sides[thin], others[0], others[1]


def _disc(f: Form, skin: Colour, flesh: Colour) -> list[Mesh]:
    thin, thick, a, b = _across(f)
    t = thick * 0.86
    profile = [(0.0, 0.0), (a * 0.86, 0.0), (a, 0.0), (a, t), (a * 0.86, t), (0.0, t)]
    parts = [lathe(profile, [flesh, skin, skin, skin, flesh], depth=b / a)]
    if f.style == "seeds":
        spots = [(cos(i * pi / 3) * a * 0.5, sin(i * pi / 3) * b * 0.5) for i in range(6)]
        seed = a * 0.17
        parts += [shifted(drum(seed, 0, t * 1.02, f.third, sides=6), x, 0, z) for x, z in spots]
    return [_stood(part, f, thin, thick) for part in parts]


def _stood(part: Mesh, f: Form, thin: int, thick: float) -> Mesh:
    if thin == 1:
        return part
    part = shifted(part, 0, -thick / 2, 0)
    if thin == 0:
        return shifted(turned(part, 90, axis=2), 0, f.height / 2, 0)
    return shifted(turned(part, 90, axis=0), 0, f.height / 2, 0)


def _wedge(f: Form, skin: Colour, flesh: Colour) -> list[Mesh]:
    """Return half a round of flesh, skin below, two seeds on top."""
    x, y, z = f.half
    rind = ball((0, y * 0.8, 0), (x, y * 0.8, z), skin, sides=12, rings=9)
    keep = rind.vertices.copy()
    keep[:, 1] = np.minimum(keep[:, 1], y * 0.8)
    top = drum(x * 0.93, y * 0.78, y, flesh, depth=z / x, sides=12)
    seeds = [
        ball((0, y, s * z * 0.2), (x * 0.1, y * 0.04, z * 0.12), SEED, sides=6, rings=4)
        for s in (-1, 1)
    ]
    return [rind._replace(vertices=keep), top, *seeds]


def _bread_slice(f: Form, crust: Colour, crumb: Colour) -> list[Mesh]:
    x, y, z = f.half
    if f.height <= min(f.width, f.depth):
        inner = box((-x * 0.86, y * 0.02, -z * 0.86), (x * 0.86, y * 1.01, z * 0.86), crumb)
        return [box((-x, 0, -z), (x, y * 0.97, z), crust), inner]
    thin = (1.0, 0.9) if f.depth <= f.width else (0.9, 1.0)
    inner_x, inner_z = (x * 0.84, z * 1.02) if thin[0] == 1.0 else (x * 1.02, z * 0.84)
    inner = box((-inner_x, y * 0.08, -inner_z), (inner_x, y * 0.9, inner_z), crumb)
    return [box((-x, 0, -z), (x, y, z), crust), inner]


def loaf(f: Form) -> list[Mesh]:
    """Return a bread with a rounded top and cuts across."""
    x, y, z = f.half
    along_z = z >= x
    body = box((-x * 0.88, 0, -z * 0.92), (x * 0.88, y * 0.52, z * 0.92), f.main)
    dome = ball((0, y * 0.5, 0), (x, y * 0.5, z), shade(f.main, 1.08), sides=16, rings=9)
    cuts = []
    for place in (-0.45, 0.0, 0.45):
        a, b = (0.55 * x, 0.05 * z) if along_z else (0.05 * x, 0.55 * z)
        px, pz = (0.0, place * z) if along_z else (place * x, 0.0)
        top = y * (0.95 if place == 0 else 0.9)
        cuts.append(ball((px, top, pz), (a, y * 0.07, b), f.second, sides=8, rings=4))
    return [body, dome, *cuts]


def egg_cracked(f: Form) -> list[Mesh]:
    """Return the white with the yolk, between two halves of the shell."""
    x, y, z = f.half
    white = mix(f.main, CRISP, 0.35) if f.cooked else f.main
    edge = mix(f.main, CRISP, 0.8) if f.cooked else shade(f.main, 0.94)
    low = max(y, 0.012)
    pan = lathe([(x, 0.0), (x * 0.95, low * 0.3), (x * 0.8, low * 0.4), (0.0, low * 0.45)],
                [edge, edge, white], depth=z / x)  # fmt: skip
    yolk = ball((0, low * 0.42, 0), (x * 0.42, max(low * 0.6, x * 0.16), z * 0.42), f.second)
    shell = [
        ball((side * x * 0.86, low * 0.4, z * 0.5), (x * 0.16, low * 0.5, z * 0.16), f.third,
             sides=6, rings=4)
        for side in (-1, 1)
    ]  # fmt: skip
    return [pan, yolk, *([] if f.cooked else shell)]


BUILDERS: dict[str, Builder] = {
    "fruit": fruit, "slice": slices, "loaf": loaf, "egg_cracked": egg_cracked,
}  # fmt: skip
