"""Build lamps, screens, machines and small devices."""

from karma.world.render.cases import cracks, glass
from karma.world.render.form import Form, shade
from karma.world.render.mesh import (
    GHOST,
    Mesh,
    ball,
    box,
    drum,
    lathe,
    shifted,
    turned,
)

WHITE, INK = (255.0, 255.0, 255.0), (20.0, 20.0, 22.0)


def lamp(f: Form) -> list[Mesh]:
    """Return a lamp with a shade that glows when on."""
    x, y, z = f.half
    wide = min(x, z)
    lit = f.third if f.on else shade(f.main, 0.8)
    low = y * (0.8 if f.style == "floor" else 0.6)
    middle = (0, low + (y - low) * 0.3, 0)
    parts = [
        drum(wide * 0.6, 0, y * 0.03 + 0.005, f.second),
        f.rod((0, 0, 0), (0, 0.95, 0), max(wide * 0.06, 0.008), f.second),
        lathe([(wide, low), (wide * 0.62, y)], lit, depth=z / x if x == wide else 1.0, glow=f.on),
        drum(wide * 0.61, y * 0.985, y * 0.99, shade(lit, 0.95), glow=f.on),
    ]
    if f.on:
        halo = [(wide * 1.5, low - y * 0.12), (wide, low)]
        parts.append(ball(middle, (wide * 0.3,) * 3, (255.0, 250.0, 220.0), glow=True))
        parts.append(lathe(halo, (255.0, 244.0, 190.0), clear=GHOST))
    return parts


def screen(f: Form) -> list[Mesh]:
    """Return a television, or a computer with its keyboard."""
    x, y, z = f.half
    desktop = f.style == "desktop"
    plane, low, wide = (
        (-z * 0.2, y * 0.25, x * 0.95) if desktop else (min(z * 0.3, 0.05), y * 0.1, x)
    )
    edge = min(0.025, wide * 0.06)
    pane = glass(wide - edge, low + edge, y - edge, 0.003, f, lit=f.on and not f.broken)
    parts = [
        box((-wide, low, plane - 0.03), (wide, y, plane), f.main),
        *[shifted(part, 0, 0, plane) for part in pane],
        box((-x * 0.08, 0, plane - 0.03), (x * 0.08, low, plane - 0.01), f.second),
        box((-x * 0.45, 0, -z * 0.6), (x * 0.45, 0.015, min(z, plane + 0.12)), f.second),
    ]
    if desktop:
        dark = (60.0, 62.0, 66.0)
        parts += [
            box((-x * 0.9, 0, z * 0.45), (x * 0.5, 0.02, z * 0.9), dark),
            box((-x * 0.85, 0.02, z * 0.5), (x * 0.45, 0.024, z * 0.85), (150.0, 152.0, 156.0)),
            ball((x * 0.75, 0.015, z * 0.7), (x * 0.1, 0.018, z * 0.12), dark),
        ]
    return parts


def phone(f: Form) -> list[Mesh]:
    """Return a phone, lying: dark, lit with icons, or cracked."""
    f = f.at_least(0.004)
    x, y, z = f.half
    lit = f.on and not f.broken
    dark = (8.0, 9.0, 12.0) if not f.broken else (44.0, 46.0, 50.0)
    parts = [
        f.box((-1, 0, -1), (1, 1, 1), f.second),
        f.on_top((-0.88, -0.86), (0.88, 0.86), f.third if lit else dark, 0.001, glow=lit),
    ]
    if lit:
        places, half = (-0.5, 0.0, 0.5), (x * 0.14, x * 0.14)
        parts += f.buttons(places, places, half, WHITE, 0.002, glow=True)
    if f.broken:
        flat = cracks(x * 0.85, -z * 0.84, z * 0.84, 0.0, (235.0, 238.0, 240.0))
        parts += [shifted(turned(part, -90, axis=0), 0, y + 0.001, 0) for part in flat]
    return parts


def toaster(f: Form) -> list[Mesh]:
    """Return a toaster with two slots that glow when on, and a lever."""
    if not f.along_x:
        return [turned(part, 90) for part in toaster(f._replace(width=f.depth, depth=f.width))]
    x, y, z = f.half
    slot = (255.0, 96.0, 24.0) if f.on else (20.0, 18.0, 18.0)
    light = (255.0, 80.0, 30.0) if f.on else f.second
    low = y * (0.35 if f.on else 0.62)
    middles = (-z * 0.42, z * 0.42)
    return [
        box((-x * 0.94, 0.01, -z), (x * 0.94, y * 0.96, z), f.main),
        f.box((-0.96, 0, -1), (0.96, 0.12, 1), f.second),
        *[
            box((-x * 0.75, y * 0.96, c - z * 0.16), (x * 0.75, y, c + z * 0.16), slot, glow=f.on)
            for c in middles
        ],
        box((x * 0.94, low, -z * 0.2), (x, low + y * 0.08, z * 0.2), f.second),
        f.in_front((0.5, 0.3), (0.7, 0.42), light, 0.004, glow=f.on),
    ]
