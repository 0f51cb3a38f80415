"""Build fixtures and machines: basins, pictures, curtains, knobs, lamps, screens, a toaster."""

from math import cos, sin

from karma.world.render.cases import cracks
from karma.world.render.form import CRACK, WATER, Form, dial, shade
from karma.world.render.mesh import (
    GHOST,
    GLASS,
    Mesh,
    bent,
    box,
    drum,
    lathe,
    rod,
    shifted,
    turned,
)


def basin(f: Form) -> list[Mesh]:
    """Return a tub, a sink's rim round its basin, or the basin itself."""
    x, y, z = f.half
    if f.style == "rim" and f.filled_parts:
        low = max(0.0, y - 0.02)
        return [box((x0, low, z0), (x1, y, z1), f.main) for x0, z0, x1, z1 in f.filled_parts]
    wall = min(0.08 if f.style == "tub" else 0.02, x * 0.2, z * 0.2)
    floor = y * (0.22 if f.style == "tub" else 0.06)
    return [
        box((-x, 0, -z), (-x + wall, y, z), f.main),
        box((x - wall, 0, -z), (x, y, z), f.main),
        box((-x, 0, -z), (x, y, -z + wall), f.main),
        box((-x, 0, z - wall), (x, y, z), f.main),
        box((-x + wall, 0, -z + wall), (x - wall, floor, z - wall), shade(f.main, 0.9)),
        drum(min(x, z) * 0.12, floor, floor + 0.004, f.second),
    ]


def shower_head(f: Form) -> list[Mesh]:
    """Return a shower head on its arm, or on a pole when it is tall; on, it rains."""
    x, y, z = f.half
    pole = y > 0.6
    top = y * 0.97
    head_y = y * (0.88 if pole else 0.45)
    low = head_y - 0.02
    wide = min(x, z) * 0.75
    front = z - wide if z > wide else 0.0
    arm = [
        (0.0, 0.0 if pole else y * 0.8, -z), (0.0, top, -z * 0.9), (0.0, top, front),
        (0.0, head_y + 0.03, front),
    ]  # fmt: skip
    parts = [
        *bent(arm, max(0.012, wide * 0.08), f.main),
        shifted(lathe([(wide * 0.3, head_y + 0.05), (wide, head_y)], f.main), 0, 0, front),
        shifted(drum(wide, low, head_y, shade(f.main, 0.8)), 0, 0, front),
    ]
    for drop in range(10 if f.on else 0):
        angle, far = drop * 2.4, wide * 0.9 * (drop / 10) ** 0.5
        a, b = sin(angle) * far, front + cos(angle) * far
        parts += [
            rod((a, low, b), (a, head_y - 0.65, b), 0.006, WATER, sides=4, clear=GHOST),
            rod((a, low, b), (a, head_y - 0.1, b), 0.008, WATER, sides=4),
        ]
    return parts


def glass_door(f: Form) -> list[Mesh]:
    """Return a pane of glass in a frame; a door swings when open, a broken one has cracks."""
    x, y, z = f.half
    z = max(z, 0.008)
    edge = 0.025
    pane = f.pane(edge, -0.003, 0.003, f.second, clear=GLASS)
    parts = [pane, *f._replace(depth=2 * z).frame(edge)]
    if f.style == "door":
        a, front = x * 0.8, z + 0.03
        parts.append(rod((a, y * 0.4, front), (a, y * 0.6, front), 0.014, (90.0, 95.0, 100.0)))
    if f.broken:
        parts += cracks(x - edge, edge, y - edge, 0.006, (245.0, 250.0, 252.0))
        parts += cracks(x - edge, edge, y * 0.6, 0.008, CRACK)
    if f.openness > 0:
        parts = [turned(part, -95 * f.openness, about=(-x, 0, 0)) for part in parts]
    return parts


def curtain(f: Form) -> list[Mesh]:
    """Return folds of cloth on a rod; an open shower curtain is pushed aside."""
    x, y, z = f.half
    parts = [rod((-x, 0.985 * y, 0), (x, 0.985 * y, 0), min(0.02, z), f.second, sides=6)]
    spans = [(-x, -x * 0.45), (x * 0.45, x)]
    if f.style == "shower":
        spans = [(-x, x - f.openness * 1.4 * x)]
    for low, high in spans:
        folds = max(3, round((high - low) / 0.09))
        step = (high - low) / folds
        for fold in range(folds):
            colour = f.main if fold % 2 else shade(f.main, 0.82)
            wave = drum(step * 0.62, 0.0, y * 0.97, colour, sides=6, depth=z / step)
            parts.append(shifted(wave, low + step * (fold + 0.5)))
    return parts


def blinds(f: Form) -> list[Mesh]:
    """Return slats: drawn up to a bundle when open, all the way down the box when closed."""
    x, y, z = f.half
    top = y - min(0.05, y * 0.25)
    parts = [box((-x, top, -z), (x, y, z), shade(f.second, 0.9))]
    low = top * min(f.openness, 1.0) * 0.75
    count = max(3, min(24, round(top / 0.045)))
    for slat in range(count):
        level = low + (top - low) * (slat + 0.5) / count
        colour = f.main if slat % 2 else f.second
        high = (top - low) / count * 0.42
        parts.append(box((-x, level - high, -z * 0.6), (x, level + high, z * 0.7), colour))
    if f.openness > 0:
        parts.append(rod((x * 0.8, 0, 0), (x * 0.8, low, 0), 0.006, (90.0, 90.0, 90.0), sides=4))
    return parts


def knob(f: Form) -> list[Mesh]:
    """Return a knob whose mark stands upright when off, and across, lit, when on."""
    x, y, z = f.half
    lying = y < min(f.width, f.depth)
    radius = min(x, z) if lying else min(x, y / 2)
    mark = f.third if f.on else f.second
    long, short = radius * 0.95, radius * 0.24
    a, b = (long, short) if f.on else (short, long)
    if lying:
        return [
            drum(radius, 0, y * 0.8, f.main),
            box((-a, y * 0.8, -b), (a, y, b), mark, glow=f.on),
        ]
    return [
        dial(radius, -z, z * 0.7, y / 2, f.main),
        box((-a, y / 2 - b, z * 0.7), (a, y / 2 + b, z), mark, glow=f.on),
    ]


# ------------------------------------------------------------------ machines


def phone(f: Form) -> list[Mesh]:
    """Return a phone, lying: dark, lit with icons, or cracked."""
    f = f.at_least(0.004)
    x, y, z = f.half
    lit = f.on and not f.broken
    dark = (8.0, 9.0, 12.0) if not f.broken else (44.0, 46.0, 50.0)
    shine = f.third if lit else dark
    parts = [
        f.box((-1, 0, -1), (1, 1, 1), f.second),
        box((-0.88 * x, y, -0.86 * z), (0.88 * x, y + 0.001, 0.86 * z), shine, glow=lit),
    ]
    if lit:
        side, places = x * 0.14, (-0.5, 0.0, 0.5)
        for a, b in ((p * x, q * z) for p in places for q in places):
            low, high = (a - side, y, b - side), (a + side, y + 0.002, b + side)
            parts.append(box(low, high, (255.0, 255.0, 255.0), glow=True))
    if f.broken:
        flat = cracks(x * 0.85, -z * 0.84, z * 0.84, 0.0, (235.0, 238.0, 240.0))
        parts += [shifted(turned(part, -90, axis=0), 0, y + 0.001, 0) for part in flat]
    return parts
