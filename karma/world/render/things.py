"""Build everything small and still: books, toys, tools, plants, cushions."""

from math import cos, sin

from karma.world.render.dishes import shards
from karma.world.render.form import Builder, Form, shade
from karma.world.render.mesh import (
    Mesh,
    ball,
    box,
    drum,
    lathe,
    ring,
    rod,
    sheet,
    shifted,
    turned,
)


def book(f: Form) -> list[Mesh]:
    """Return a closed book, or an open one with two white pages."""
    x, y, z = f.half
    y = max(y, 0.01)
    if f.openness <= 0:
        return [
            box((-x, 0, -z), (x, y * 0.12, z), f.main), box((-x, y * 0.88, -z), (x, y, z), f.main),
            box((-x, 0, -z), (-x + 0.012, y, z), f.main),
            box((-x * 0.96, y * 0.1, -z * 0.96), (x * 0.97, y * 0.9, z * 0.96), f.second),
            box((-x * 0.5, y, z * 0.2), (x * 0.5, y + 0.002, z * 0.5), shade(f.second, 0.95)),
        ]  # fmt: skip
    lines = [
        box(
            (a * x - x * 0.34, y * 0.9, b * z),
            (a * x + x * 0.34, y * 0.9 + 0.002, b * z + z * 0.05),
            (120.0, 116.0, 110.0),
        )
        for a in (-0.5, 0.5)
        for b in (-0.7, -0.4, -0.1, 0.2, 0.5)
    ]
    return [
        box((-x, 0, -z), (x, y * 0.3, z), f.main),
        box((-x * 0.95, y * 0.3, -z * 0.95), (-x * 0.02, y * 0.9, z * 0.95), f.second),
        box((x * 0.02, y * 0.3, -z * 0.95), (x * 0.95, y * 0.9, z * 0.95), f.second),
        box((-x * 0.02, y * 0.3, -z * 0.95), (x * 0.02, y * 0.6, z * 0.95), shade(f.second, 0.6)),
        *lines,
    ]


def newspaper(f: Form) -> list[Mesh]:
    """Return folded paper with a heading, lines and a picture."""
    x, y, z = f.half
    y = max(y, 0.01)
    rows = [-0.75, -0.55, -0.35, -0.15, 0.05, 0.25]
    return [
        box((-x, 0, -z), (x, y, z), f.main),
        box((-x * 0.85, y, z * 0.6), (x * 0.85, y + 0.002, z * 0.85), f.second),
        box((x * 0.1, y, -z * 0.3), (x * 0.85, y + 0.002, z * 0.4), (120.0, 122.0, 126.0)),
        *[box((-x * 0.85, y, r * z), (0, y + 0.002, r * z + z * 0.07), f.second) for r in rows],
    ]


def stick(f: Form) -> list[Mesh]:
    """Return a pen, a pencil, a bat or a racket along z."""
    return {"bat": _bat, "racket": _racket}.get(f.style, _pen)(f)


def _pen(f: Form) -> list[Mesh]:
    x, y, z = f.half
    radius = max(min(x, y / 2), 0.004)
    level = radius
    back, tip = f.second, f.third
    return [
        rod((0, level, -z), (0, level, -z * 0.75), radius * 1.02, back, sides=6),
        rod((0, level, -z * 0.75), (0, level, z * 0.75), radius, f.main, sides=6),
        rod((0, level, z * 0.75), (0, level, z), radius, tip, sides=6, thin=0.0008),
    ]


def _bat(f: Form) -> list[Mesh]:
    x, y, z = f.half
    radius = min(x, y / 2)
    return [
        rod((0, radius, -z), (0, radius, -z * 0.96), radius * 0.6, f.second),
        rod(
            (0, radius, -z * 0.96),
            (0, radius, -z * 0.45),
            radius * 0.38,
            f.second,
            thin=radius * 0.42,
        ),
        rod(
            (0, radius, -z * 0.45),
            (0, radius, z * 0.3),
            radius * 0.42,
            f.main,
            thin=radius,
            sides=10,
        ),
        rod((0, radius, z * 0.3), (0, radius, z), radius, f.main, thin=radius * 0.9, sides=10),
    ]


def _racket(f: Form) -> list[Mesh]:
    x, y, z = f.half
    level = y / 2
    long = f.depth * 0.28
    middle = z - long
    hoop = lathe(
        [(x * 0.86, -0.01), (x, -0.01), (x, 0.01), (x * 0.86, 0.01), (x * 0.86, -0.01)], f.main,
        depth=long / x, sides=18,
    )  # fmt: skip
    strings = [
        rod(
            (a * x, level, middle - long * 0.75),
            (a * x, level, middle + long * 0.75),
            0.003,
            f.third,
            sides=3,
        )
        for a in (-0.5, -0.25, 0.0, 0.25, 0.5)
    ] + [
        rod(
            (-x * 0.8, level, middle + b * long),
            (x * 0.8, level, middle + b * long),
            0.003,
            f.third,
            sides=3,
        )
        for b in (-0.6, -0.3, 0.0, 0.3, 0.6)
    ]
    grip = rod((0, level, -z), (0, level, -z * 0.4), 0.02, f.second)
    shaft = rod((0, level, -z * 0.4), (0, level, middle - long * 0.9), 0.014, f.main)
    return [shifted(hoop, 0, level, middle), *strings, grip, shaft]


def upright_stick(f: Form) -> list[Mesh]:
    """Return a plunger or a toilet brush, standing."""
    x, y, z = f.half
    wide = min(x, z)
    stick = rod((0, y * 0.2, 0), (0, y, 0), max(wide * 0.14, 0.008), f.second)
    if f.style == "plunger":
        cup = lathe(
            [(wide, 0.0), (wide * 0.9, y * 0.12), (wide * 0.35, y * 0.22), (0.0, y * 0.26)], f.main
        )
        return [cup, stick]
    pot = lathe(
        [
            (0.0, 0.0),
            (wide, 0.0),
            (wide * 0.8, y * 0.36),
            (wide * 0.6, y * 0.36),
            (wide * 0.6, y * 0.2),
        ],
        f.main,
    )
    bristles = drum(wide * 0.5, y * 0.2, y * 0.44, (235.0, 238.0, 225.0), sides=10)
    return [
        pot,
        bristles,
        stick,
        ball((0, y * 0.97, 0), (wide * 0.25,) * 3, f.second, sides=8, rings=5),
    ]


def disc(f: Form) -> list[Mesh]:
    """Return a CD: a shining ring with a hole."""
    x, y, z = f.half
    y = max(y, 0.003)
    profile = [(x * 0.14, 0), (x, 0), (x, y), (x * 0.75, y), (x * 0.4, y), (x * 0.14, y)]
    colours = [f.main, f.main, f.main, f.second, shade(f.main, 1.1)]
    return [lathe(profile, colours, depth=z / x, sides=20)]


def sponge(f: Form) -> list[Mesh]:
    """Return a yellow sponge with a green scouring side and holes."""
    x, y, z = f.half
    holes = [(-0.5, -0.5), (0.4, -0.2), (-0.2, 0.3), (0.5, 0.6), (0.0, -0.7), (-0.6, 0.7)]
    return [
        box((-x, 0, -z), (x, y * 0.3, z), f.second),
        box((-x, y * 0.3, -z), (x, y, z), f.main),
        *[
            shifted(drum(x * 0.11, y, y + 0.001, shade(f.main, 0.7), sides=6), a * x, 0, b * z)
            for a, b in holes
        ],
    ]


def soap(f: Form) -> list[Mesh]:
    """Return a rounded bar."""
    x, y, z = f.half
    body = ball((0, y / 2, 0), (x, y / 2, z), f.main, sides=14)
    mark = ball(
        (0, y * 0.93, 0), (x * 0.5, y * 0.09, z * 0.4), shade(f.main, 0.85), sides=10, rings=4
    )
    return [body, mark]


def dumbbell(f: Form) -> list[Mesh]:
    """Return two weights on a bar along z."""
    x, y, z = f.half
    radius = min(x, y / 2)
    return [
        rod((0, radius, -z * 0.6), (0, radius, z * 0.6), radius * 0.25, f.second),
        *[
            rod((0, radius, s * z * 0.45), (0, radius, s * z), radius, f.main, sides=6)
            for s in (-1, 1)
        ],
    ]


def boots(f: Form) -> list[Mesh]:
    """Return a pair of boots."""
    x, y, z = f.half
    parts = []
    for side in (-1, 1):
        a = side * x * 0.52
        leg = lathe([(x * 0.36, y * 0.1), (x * 0.38, y), (x * 0.28, y), (x * 0.25, y * 0.5)],
                    [f.main, f.main, f.second], depth=1.1)  # fmt: skip
        parts += [
            shifted(leg, a, 0, -z * 0.4),
            ball((a, y * 0.14, z * 0.2), (x * 0.4, y * 0.14, z * 0.75), f.main, sides=10),
            box((a - x * 0.4, 0, -z * 0.9), (a + x * 0.4, y * 0.06, z * 0.95), f.second),
        ]
    return parts


def garbage_bag(f: Form) -> list[Mesh]:
    """Return a full bag with a knot."""
    x, y, z = f.half
    profile = ((0.7, 0), (1, 0.25), (0.9, 0.55), (0.35, 0.8), (0.12, 0.86), (0.3, 1))
    body = lathe(
        [(x * wide, y * high) for wide, high in profile],
        [f.main, f.second, f.main, f.second, f.main],
        depth=z / x,
        sides=11,
    )
    return [
        body,
        ball((0, y * 0.86, 0), (x * 0.18, y * 0.05, z * 0.18), f.second, sides=8, rings=5),
    ]


def plant(f: Form) -> list[Mesh]:
    """Return leaves in a pot with earth; watered, the earth is under water."""
    x, y, z = f.half
    wide = min(x, z) * 0.62
    top = y * 0.36
    pot = lathe(
        [(0.0, 0.0), (wide * 0.7, 0.0), (wide, top), (wide * 0.85, top), (wide * 0.8, top * 0.85)],
        f.second,
    )
    earth = drum(wide * 0.84, top * 0.8, top * 0.92, f.liquid if f.filled else (74.0, 50.0, 32.0))
    parts = [pot, earth]
    for leaf in range(11):
        angle = leaf * 2.39996
        far = 0.35 + 0.6 * ((leaf * 7) % 11) / 11
        high = y * (0.58 + 0.4 * ((leaf * 5) % 11) / 11)
        end = (sin(angle) * x * far * 0.85, high * 0.96, cos(angle) * z * far * 0.85)
        colour = f.main if leaf % 2 else f.third
        parts.append(rod((0, top * 0.8, 0), end, wide * 0.03 + 0.002, shade(f.main, 0.7), sides=3))
        half = (x * 0.2, y * 0.045, z * 0.2)
        parts.append(ball(end, half, colour, sides=6, rings=4))
    return parts


def keys(f: Form) -> list[Mesh]:
    """Return two keys on a ring."""
    x, y, z = f.half
    r = min(x, z) * 0.5
    y = max(y, 0.006)
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
    seam = box((-x * 0.99, y * 0.42, -z * 0.99), (x * 0.99, y * 0.48, z * 0.99), shade(f.main, 0.7))
    return [top._replace(vertices=points), top._replace(vertices=under), seam]


def statue(f: Form) -> list[Mesh]:
    """Return a bust on a plinth."""
    if f.broken:
        return shards(f)
    x, y, z = f.half
    wide = min(x, z)
    profile = ((0.5, 0.14), (0.4, 0.3), (0.85, 0.52), (0.25, 0.66), (0.22, 0.7))
    return [
        box((-x * 0.8, 0, -z * 0.8), (x * 0.8, y * 0.14, z * 0.8), f.second),
        lathe([(wide * a, y * b) for a, b in profile], f.main),
        ball((0, y * 0.84, 0), (wide * 0.42, y * 0.16, wide * 0.46), f.main, sides=12),
        box((-wide * 0.07, y * 0.8, wide * 0.4), (wide * 0.07, y * 0.87, wide * 0.58), f.main),
    ]


def decor(f: Form) -> list[Mesh]:
    """Return an ornament: a foot, a stem and coloured balls."""
    x, y, z = f.half
    wide = min(x, z)
    parts = [
        lathe(
            [(0.0, 0.0), (x * 0.9, 0.0), (x * 0.5, y * 0.2), (x * 0.3, y * 0.3)],
            f.main,
            depth=z / x,
        ),
        rod((0, y * 0.2, 0), (0, y * 0.9, 0), wide * 0.07, f.main),
    ]
    places = (
        (0, 0.88, 0),
        (-0.5, 0.6, 0.2),
        (0.5, 0.65, -0.2),
        (0.1, 0.5, 0.5),
        (-0.1, 0.72, -0.5),
    )
    for number, (a, b, c) in enumerate(places):
        r = min(wide * 0.36, y * 0.12)
        colour = (f.second, f.third)[number % 2]
        parts.append(ball((a * x, b * y, c * z), (r, r, r), colour, sides=8, rings=5))
        parts.append(rod((0, b * y * 0.8, 0), (a * x, b * y, c * z), wide * 0.04, f.main, sides=4))
    return parts


def teddy(f: Form) -> list[Mesh]:
    """Return a sitting bear."""
    x, y, z = f.half
    fur, light, dark = f.main, f.second, f.third
    parts = [
        ball((0, y * 0.32, 0), (x * 0.62, y * 0.32, z * 0.6), fur),
        ball((0, y * 0.3, z * 0.25), (x * 0.4, y * 0.22, z * 0.4), light),
        ball((0, y * 0.74, 0), (x * 0.5, y * 0.23, z * 0.5), fur),
        ball((0, y * 0.69, z * 0.4), (x * 0.22, y * 0.1, z * 0.24), light, sides=8, rings=5),
        ball((0, y * 0.72, z * 0.6), (x * 0.08, y * 0.04, z * 0.08), dark, sides=6, rings=4),
    ]
    pairs = [  # ears, eyes, arms and legs: middle, half sizes, colour, sides and rings
        ((0.42, 0.93, 0.0), (0.18, 0.08, 0.1), fur, 8, 5),
        ((0.2, 0.79, 0.44), (0.06, 0.03, 0.06), dark, 6, 4),
        ((0.72, 0.42, 0.2), (0.24, 0.17, 0.22), fur, 8, 5),
        ((0.52, 0.12, 0.62), (0.24, 0.12, 0.36), fur, 8, 5),
    ]
    for side in (-1, 1):
        for (a, b, c), (wide, high, deep), colour, sides, rings in pairs:
            half = (x * wide, y * high, z * deep)
            middle = (side * x * a, y * b, z * c)
            parts.append(ball(middle, half, colour, sides=sides, rings=rings))
    return parts


def tissue_box(f: Form) -> list[Mesh]:
    """Return a box with a tissue sticking out; used up, only the dark slot."""
    x, y, z = f.half
    top = y * 0.62
    parts = [
        box((-x, 0, -z), (x, top, z), f.main),
        box(
            (-x * 1.005, top * 0.3, -z * 1.005),
            (x * 1.005, top * 0.5, z * 1.005),
            shade(f.main, 1.3),
        ),
        drum(min(x, z) * 0.55, top, top + 0.002, f.third, depth=0.6),
    ]
    if f.used_up:
        return parts
    wide = min(x, z) * 0.6
    tissue = lathe(
        [(wide * 0.4, top), (wide, y * 0.95), (wide * 0.5, y), (0.0, y * 0.9)],
        f.second,
        sides=7,
        depth=0.5,
    )
    return [*parts, tissue]


BUILDERS: dict[str, Builder] = {
    "book": book, "newspaper": newspaper, "stick": stick, "upright_stick": upright_stick,
    "disc": disc, "sponge": sponge, "soap": soap, "dumbbell": dumbbell, "boots": boots,
    "garbage_bag": garbage_bag, "plant": plant, "keys": keys, "pillow": pillow, "statue": statue,
    "decor": decor, "teddy": teddy, "tissue_box": tissue_box,
}  # fmt: skip
