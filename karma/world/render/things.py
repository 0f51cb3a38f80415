"""Build everything small and still: books, toys, tools, plants, cushions."""

from math import cos, sin

from karma.world.render.dishes import shards
from karma.world.render.form import SIDES, Builder, Form, shade
from karma.world.render.mesh import Mesh, ball, box, drum, lathe, ring, rod, sheet, shifted, turned


def book(f: Form) -> list[Mesh]:
    """Return a closed book, or an open one with two white pages."""
    f = f.at_least(0.01)
    x, y, z = f.half
    if f.openness <= 0:
        return [
            f.box((-1, 0, -1), (1, 0.12, 1), f.main),
            f.box((-1, 0.88, -1), (1, 1, 1), f.main),
            box((-x, 0, -z), (-x + 0.012, y, z), f.main),
            f.box((-0.96, 0.1, -0.96), (0.97, 0.9, 0.96), f.second),
            f.on_top((-0.5, 0.2), (0.5, 0.5), shade(f.second, 0.95)),
        ]
    page = y * 0.9
    left, right = -0.5 * x, 0.5 * x
    lines = [
        box(
            (middle - x * 0.34, page, b * z),
            (middle + x * 0.34, page + 0.002, b * z + z * 0.05),
            (120.0, 116.0, 110.0),
        )
        for middle in (left, right)
        for b in (-0.7, -0.4, -0.1, 0.2, 0.5)
    ]
    return [
        f.box((-1, 0, -1), (1, 0.3, 1), f.main),
        f.box((-0.95, 0.3, -0.95), (-0.02, 0.9, 0.95), f.second),
        f.box((0.02, 0.3, -0.95), (0.95, 0.9, 0.95), f.second),
        f.box((-0.02, 0.3, -0.95), (0.02, 0.6, 0.95), shade(f.second, 0.6)),
        *lines,
    ]


def newspaper(f: Form) -> list[Mesh]:
    """Return folded paper with a heading, lines and a picture."""
    f = f.at_least(0.01)
    x, y, z = f.half
    rows = [r * z for r in (-0.75, -0.55, -0.35, -0.15, 0.05, 0.25)]
    return [
        f.box((-1, 0, -1), (1, 1, 1), f.main),
        f.on_top((-0.85, 0.6), (0.85, 0.85), f.second),
        f.on_top((0.1, -0.3), (0.85, 0.4), (120.0, 122.0, 126.0)),
        *[box((-x * 0.85, y, low), (0, y + 0.002, low + z * 0.07), f.second) for low in rows],
    ]


def pen(f: Form) -> list[Mesh]:
    """Return a pen or a pencil along z."""
    x, y, z = f.half
    radius = max(min(x, y / 2), 0.004)
    return [
        rod((0, radius, -z), (0, radius, -z * 0.75), radius * 1.02, f.second, sides=6),
        rod((0, radius, -z * 0.75), (0, radius, z * 0.75), radius, f.main, sides=6),
        rod((0, radius, z * 0.75), (0, radius, z), radius, f.third, sides=6, thin=0.0008),
    ]


def bat(f: Form) -> list[Mesh]:
    """Return a baseball bat along z."""
    x, y, z = f.half
    r = min(x, y / 2)
    return [
        rod((0, r, -z), (0, r, -z * 0.96), r * 0.6, f.second),
        rod((0, r, -z * 0.96), (0, r, -z * 0.45), r * 0.38, f.second, thin=r * 0.42),
        rod((0, r, -z * 0.45), (0, r, z * 0.3), r * 0.42, f.main, thin=r, sides=10),
        rod((0, r, z * 0.3), (0, r, z), r, f.main, thin=r * 0.9, sides=10),
    ]


def racket(f: Form) -> list[Mesh]:
    """Return a tennis racket along z."""
    x, y, z = f.half
    level = y / 2
    long = f.depth * 0.28
    middle = z - long
    section = [(x * 0.86, -0.01), (x, -0.01), (x, 0.01), (x * 0.86, 0.01), (x * 0.86, -0.01)]
    hoop = lathe(section, f.main, depth=long / x, sides=18)
    near, far = middle - long * 0.75, middle + long * 0.75
    strings = [
        rod((a * x, level, near), (a * x, level, far), 0.003, f.third, sides=3)
        for a in (-0.5, -0.25, 0.0, 0.25, 0.5)
    ]
    rows = [middle + b * long for b in (-0.6, -0.3, 0.0, 0.3, 0.6)]
    strings += [
        rod((-x * 0.8, level, at), (x * 0.8, level, at), 0.003, f.third, sides=3) for at in rows
    ]
    grip = rod((0, level, -z), (0, level, -z * 0.4), 0.02, f.second)
    shaft = rod((0, level, -z * 0.4), (0, level, middle - long * 0.9), 0.014, f.main)
    return [shifted(hoop, 0, level, middle), *strings, grip, shaft]


def upright_stick(f: Form) -> list[Mesh]:
    """Return a plunger or a toilet brush, standing."""
    x, y, z = f.half
    wide = min(x, z)
    stick = f.rod((0, 0.2, 0), (0, 1, 0), max(wide * 0.14, 0.008), f.second)
    if f.style == "plunger":
        return [f.lathe([(1, 0), (0.9, 0.12), (0.35, 0.22), (0, 0.26)], f.main, radius=wide), stick]
    profile = [(0, 0), (1, 0), (0.8, 0.36), (0.6, 0.36), (0.6, 0.2)]
    return [
        f.lathe(profile, f.main, radius=wide),
        drum(wide * 0.5, y * 0.2, y * 0.44, (235.0, 238.0, 225.0), sides=10),
        stick,
        ball((0, y * 0.97, 0), (wide * 0.25,) * 3, f.second, sides=8, rings=5),
    ]


def disc(f: Form) -> list[Mesh]:
    """Return a CD: a shining ring with a hole."""
    profile = [(0.14, 0), (1, 0), (1, 1), (0.75, 1), (0.4, 1), (0.14, 1)]
    colours = [f.main, f.main, f.main, f.second, shade(f.main, 1.1)]
    return [f.at_least(0.003).lathe(profile, colours, sides=20)]


def sponge(f: Form) -> list[Mesh]:
    """Return a yellow sponge with a green scouring side and holes."""
    x, y, z = f.half
    hole = drum(x * 0.11, y, y + 0.001, shade(f.main, 0.7), sides=6)
    places = [(-0.5, -0.5), (0.4, -0.2), (-0.2, 0.3), (0.5, 0.6), (0.0, -0.7), (-0.6, 0.7)]
    return [
        f.box((-1, 0, -1), (1, 0.3, 1), f.second),
        f.box((-1, 0.3, -1), (1, 1, 1), f.main),
        *[shifted(hole, a * x, 0, b * z) for a, b in places],
    ]


def soap(f: Form) -> list[Mesh]:
    """Return a rounded bar."""
    mark = shade(f.main, 0.85)
    return [
        f.ball((0, 0.5, 0), (1, 0.5, 1), f.main, sides=14),
        f.ball((0, 0.93, 0), (0.5, 0.09, 0.4), mark, sides=10, rings=4),
    ]


def dumbbell(f: Form) -> list[Mesh]:
    """Return two weights on a bar along z."""
    x, y, z = f.half
    r = min(x, y / 2)
    return [
        rod((0, r, -z * 0.6), (0, r, z * 0.6), r * 0.25, f.second),
        *[rod((0, r, s * z * 0.45), (0, r, s * z), r, f.main, sides=6) for s in SIDES],
    ]


def boots(f: Form) -> list[Mesh]:
    """Return a pair of boots."""
    x, y, z = f.half
    leg = [(x * 0.36, y * 0.1), (x * 0.38, y), (x * 0.28, y), (x * 0.25, y * 0.5)]
    parts = []
    for side in SIDES:
        a = side * x * 0.52
        parts += [
            shifted(lathe(leg, [f.main, f.main, f.second], depth=1.1), a, 0, -z * 0.4),
            ball((a, y * 0.14, z * 0.2), (x * 0.4, y * 0.14, z * 0.75), f.main, sides=10),
            box((a - x * 0.4, 0, -z * 0.9), (a + x * 0.4, y * 0.06, z * 0.95), f.second),
        ]
    return parts


def garbage_bag(f: Form) -> list[Mesh]:
    """Return a full bag with a knot."""
    profile = ((0.7, 0), (1, 0.25), (0.9, 0.55), (0.35, 0.8), (0.12, 0.86), (0.3, 1))
    return [
        f.lathe(profile, [f.main, f.second, f.main, f.second, f.main], sides=11),
        f.ball((0, 0.86, 0), (0.18, 0.05, 0.18), f.second, sides=8, rings=5),
    ]


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


def keys(f: Form) -> list[Mesh]:
    """Return two keys on a ring."""
    f = f.at_least(0.006)
    x, y, z = f.half
    r = min(x, z) * 0.5
    parts = [ring((-x * 0.5, y / 2, 0), r, r * 0.2, f.second)]
    for turn, colour in ((-22, f.main), (22, f.second)):
        key = [
            drum(r * 0.45, 0, y, colour, sides=8),
            box((0, 0, -r * 0.12), (x * 1.1, y, r * 0.12), colour),
            box((x * 0.8, 0, 0), (x * 0.9, y, r * 0.4), colour),
            box((x * 1.0, 0, 0), (x * 1.1, y, r * 0.4), colour),
        ]
        parts += [shifted(turned(part, turn), -x * 0.15, 0, 0) for part in key]
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


def statue(f: Form) -> list[Mesh]:
    """Return a bust on a plinth."""
    if f.broken:
        return shards(f)
    x, y, z = f.half
    wide = min(x, z)
    profile = ((0.5, 0.14), (0.4, 0.3), (0.85, 0.52), (0.25, 0.66), (0.22, 0.7))
    return [
        f.box((-0.8, 0, -0.8), (0.8, 0.14, 0.8), f.second),
        f.lathe(profile, f.main, radius=wide),
        ball((0, y * 0.84, 0), (wide * 0.42, y * 0.16, wide * 0.46), f.main, sides=12),
        box((-wide * 0.07, y * 0.8, wide * 0.4), (wide * 0.07, y * 0.87, wide * 0.58), f.main),
    ]


def decor(f: Form) -> list[Mesh]:
    """Return an ornament: a foot, a stem and coloured balls."""
    x, y, z = f.half
    wide = min(x, z)
    r = min(wide * 0.36, y * 0.12)
    parts = [
        f.lathe([(0, 0), (0.9, 0), (0.5, 0.2), (0.3, 0.3)], f.main),
        f.rod((0, 0.2, 0), (0, 0.9, 0), wide * 0.07, f.main),
    ]
    places = (
        (0, 0.88, 0), (-0.5, 0.6, 0.2), (0.5, 0.65, -0.2), (0.1, 0.5, 0.5), (-0.1, 0.72, -0.5),
    )  # fmt: skip
    for number, place in enumerate(places):
        end, colour = f.at(*place), (f.second, f.third)[number % 2]
        parts.append(ball(end, (r, r, r), colour, sides=8, rings=5))
        parts.append(rod((0, end[1] * 0.8, 0), end, wide * 0.04, f.main, sides=4))
    return parts


def teddy(f: Form) -> list[Mesh]:
    """Return a sitting bear."""
    fur, light, dark = f.main, f.second, f.third
    parts = [
        f.ball((0, 0.32, 0), (0.62, 0.32, 0.6), fur),
        f.ball((0, 0.3, 0.25), (0.4, 0.22, 0.4), light),
        f.ball((0, 0.74, 0), (0.5, 0.23, 0.5), fur),
        f.ball((0, 0.69, 0.4), (0.22, 0.1, 0.24), light, sides=8, rings=5),
        f.ball((0, 0.72, 0.6), (0.08, 0.04, 0.08), dark, sides=6, rings=4),
    ]
    pairs = [  # ears, eyes, arms and legs: middle, half sizes, colour, sides and rings
        ((0.42, 0.93, 0.0), (0.18, 0.08, 0.1), fur, 8, 5),
        ((0.2, 0.79, 0.44), (0.06, 0.03, 0.06), dark, 6, 4),
        ((0.72, 0.42, 0.2), (0.24, 0.17, 0.22), fur, 8, 5),
        ((0.52, 0.12, 0.62), (0.24, 0.12, 0.36), fur, 8, 5),
    ]
    for side in SIDES:
        for (a, b, c), half, colour, sides, rings in pairs:
            parts.append(f.ball((side * a, b, c), half, colour, sides=sides, rings=rings))
    return parts


def tissue_box(f: Form) -> list[Mesh]:
    """Return a box with a tissue sticking out; used up, only the dark slot."""
    x, y, z = f.half
    top = y * 0.62
    wide = min(x, z) * 0.6
    paper = [(wide * 0.4, top), (wide, y * 0.95), (wide * 0.5, y), (0.0, y * 0.9)]
    low = f._replace(height=top)
    return [
        low.box((-1, 0, -1), (1, 1, 1), f.main),
        low.box((-1.005, 0.3, -1.005), (1.005, 0.5, 1.005), shade(f.main, 1.3)),
        drum(min(x, z) * 0.55, top, top + 0.002, f.third, depth=0.6),
        *([] if f.used_up else [lathe(paper, f.second, sides=7, depth=0.5)]),
    ]


BUILDERS: dict[str, Builder] = {
    "book": book, "newspaper": newspaper, "pen": pen, "bat": bat, "racket": racket,
    "upright_stick": upright_stick, "disc": disc, "sponge": sponge, "soap": soap,
    "dumbbell": dumbbell, "boots": boots, "garbage_bag": garbage_bag, "plant": plant, "keys": keys,
    "pillow": pillow, "statue": statue, "decor": decor, "teddy": teddy, "tissue_box": tissue_box,
}  # fmt: skip
