"""Build lamps, screens, machines and small devices."""

from karma.world.render.cases import cracks, glass
from karma.world.render.form import Builder, Form, shade
from karma.world.render.mesh import (
    GHOST,
    Mesh,
    ball,
    bent,
    box,
    drum,
    lathe,
    ring,
    rod,
    shifted,
    turned,
)


def lamp(f: Form) -> list[Mesh]:
    """Return a lamp with a shade that glows when on."""
    x, y, z = f.half
    wide = min(x, z)
    lit = f.third if f.on else shade(f.main, 0.8)
    foot = drum(wide * 0.6, 0, y * 0.03 + 0.005, f.second)
    low = y * (0.8 if f.style == "floor" else 0.6)
    cone = lathe([(wide, low), (wide * 0.62, y)], lit, depth=z / x if x == wide else 1.0, glow=f.on)
    top = drum(wide * 0.61, y * 0.985, y * 0.99, shade(lit, 0.95), glow=f.on)
    bulb = ball((0, low + (y - low) * 0.3, 0), (wide * 0.3,) * 3, (255.0, 250.0, 220.0), glow=True)
    stem = rod((0, 0, 0), (0, y * 0.95, 0), max(wide * 0.06, 0.008), f.second)
    halo = lathe([(wide * 1.5, low - y * 0.12), (wide, low)], (255.0, 244.0, 190.0), clear=GHOST)
    return [foot, stem, cone, top, *([bulb, halo] if f.on else [])]


def candle(f: Form) -> list[Mesh]:
    """Return a candle, with a flame when on."""
    x, y, z = f.half
    top = y * 0.8
    parts = [
        lathe(
            [(0.0, 0.0), (x, 0.0), (x * 0.95, top), (x * 0.6, top * 0.97), (0.0, top * 0.95)],
            f.main,
            depth=z / x,
        ),
        rod((0, top * 0.95, 0), (0, top + y * 0.08, 0), max(x * 0.08, 0.002), f.second, sides=4),
    ]
    if f.on:
        wide = x * 0.5
        profile = [
            (0.0, top),
            (wide, top + y * 0.12),
            (wide * 0.6, top + y * 0.26),
            (0.0, top + y * 0.45),
        ]
        parts.append(lathe(profile, f.third, sides=8, glow=True))
        parts.append(
            ball(
                (0, top + y * 0.1, 0),
                (wide * 0.5, y * 0.1, wide * 0.5),
                (255.0, 250.0, 210.0),
                sides=6,
                rings=5,
                glow=True,
            )
        )
        parts.append(
            ball((0, top + y * 0.15, 0), (x * 2, x * 2, x * 2), (255.0, 225.0, 130.0), clear=GHOST)
        )
    return parts


def screen(f: Form) -> list[Mesh]:
    """Return a television, or a computer with its keyboard."""
    x, y, z = f.half
    lit = f.on and not f.broken
    desktop = f.style == "desktop"
    plane = -z * 0.2 if desktop else min(z * 0.3, 0.05)
    low = y * (0.25 if desktop else 0.1)
    wide = x * (0.95 if desktop else 1.0)
    edge = min(0.025, wide * 0.06)
    panel = [
        box((-wide, low, plane - 0.03), (wide, y, plane), f.main),
        *[
            shifted(part, 0, 0, plane)
            for part in glass(wide - edge, low + edge, y - edge, 0.003, f, lit=lit)
        ],
    ]
    stand = [
        box((-x * 0.08, 0, plane - 0.03), (x * 0.08, low, plane - 0.01), f.second),
        box((-x * 0.45, 0, -z * 0.6), (x * 0.45, 0.015, min(z, plane + 0.12)), f.second),
    ]
    if not desktop:
        return [*panel, *stand]
    keys = [
        box((-x * 0.9, 0, z * 0.45), (x * 0.5, 0.02, z * 0.9), (60.0, 62.0, 66.0)),
        box((-x * 0.85, 0.02, z * 0.5), (x * 0.45, 0.024, z * 0.85), (150.0, 152.0, 156.0)),
        ball((x * 0.75, 0.015, z * 0.7), (x * 0.1, 0.018, z * 0.12), (60.0, 62.0, 66.0)),
    ]
    return [*panel, *stand, *keys]


def device(f: Form) -> list[Mesh]:
    """Return a phone, a remote control or a card, lying."""
    x, y, z = f.half
    y = max(y, 0.004)
    if f.style == "card":
        return [
            box((-x, 0, -z), (x, y, z), f.main),
            box((-x, y, z * 0.45), (x, y + 0.001, z * 0.75), (25.0, 25.0, 28.0)),
            box((-x * 0.3, y, -z * 0.5), (x * 0.2, y + 0.001, -z * 0.2), f.second),
        ]
    if f.style == "remote":
        buttons = [
            box(
                (a * x - x * 0.2, y, b * z - z * 0.05),
                (a * x + x * 0.2, y + 0.004, b * z + z * 0.05),
                f.second,
            )
            for a in (-0.5, 0.0, 0.5)
            for b in (-0.6, -0.35, -0.1, 0.15, 0.4)
        ]
        power = drum(x * 0.22, y, y + 0.005, f.third)
        return [box((-x, 0, -z), (x, y, z), f.main), *buttons, shifted(power, 0, 0, z * 0.75)]
    lit = f.on and not f.broken
    dark = (8.0, 9.0, 12.0) if not f.broken else (44.0, 46.0, 50.0)
    pane = box(
        (-x * 0.88, y, -z * 0.86),
        (x * 0.88, y + 0.001, z * 0.86),
        f.third if lit else dark,
        glow=lit,
    )
    parts = [box((-x, 0, -z), (x, y, z), f.second), pane]
    if lit:
        icons = [(a, b) for a in (-0.5, 0.0, 0.5) for b in (-0.5, 0.0, 0.5)]
        parts += [
            box(
                (a * x - x * 0.14, y, b * z - x * 0.14),
                (a * x + x * 0.14, y + 0.002, b * z + x * 0.14),
                (255.0, 255.0, 255.0),
                glow=True,
            )
            for a, b in icons
        ]
    if f.broken:
        flat = cracks(x * 0.85, -z * 0.84, z * 0.84, 0.0, (235.0, 238.0, 240.0))
        parts += [shifted(turned(part, -90, axis=0), 0, y + 0.001, 0) for part in flat]
    return parts


def coffee_machine(f: Form) -> list[Mesh]:
    """Return a coffee machine: back, head over a drip tray; on, a light and a stream."""
    x, y, z = f.half
    parts = [
        box((-x, 0, -z), (x, y, -z * 0.1), f.main),
        box((-x, y * 0.68, -z), (x, y, z * 0.9), f.main),
        box((-x, 0, -z * 0.1), (x, y * 0.07, z), f.second),
        box((-x * 0.8, y * 0.07, 0), (x * 0.8, y * 0.08, z * 0.9), (40.0, 40.0, 42.0)),
        box((-x * 0.25, y * 0.6, z * 0.25), (x * 0.25, y * 0.68, z * 0.65), f.second),
        box((-x * 0.9, y * 0.2, -z * 0.1), (x * 0.9, y * 0.64, -z * 0.08), shade(f.main, 1.5)),
    ]
    light = (255.0, 70.0, 40.0) if f.on else f.third
    parts.append(box((-x * 0.5, y * 0.8, z * 0.9), (x * 0.5, y * 0.9, z * 0.93), light, glow=f.on))
    if f.on:
        parts.append(
            rod((0, y * 0.6, z * 0.45), (0, y * 0.1, z * 0.45), 0.007, (70.0, 36.0, 14.0), sides=5)
        )
    return parts


def toaster(f: Form) -> list[Mesh]:
    """Return a toaster with two slots that glow when on, and a lever."""
    x, y, z = f.half
    along_x = f.width >= f.depth
    if not along_x:
        sides = f._replace(width=f.depth, depth=f.width)
        return [turned(part, 90) for part in toaster(sides)]
    slot = (255.0, 96.0, 24.0) if f.on else (20.0, 18.0, 18.0)
    low = y * (0.35 if f.on else 0.62)
    return [
        box((-x * 0.94, 0.01, -z), (x * 0.94, y * 0.96, z), f.main),
        box((-x * 0.96, 0, -z * 1.0), (x * 0.96, y * 0.12, z), f.second),
        *[
            box((-x * 0.75, y * 0.96, c - z * 0.16), (x * 0.75, y, c + z * 0.16), slot, glow=f.on)
            for c in (-z * 0.42, z * 0.42)
        ],
        box((x * 0.94, low, -z * 0.2), (x, low + y * 0.08, z * 0.2), f.second),
        box((x * 0.5, y * 0.3, z), (x * 0.7, y * 0.42, z + 0.004),
            (255.0, 80.0, 30.0) if f.on else f.second, glow=f.on),
    ]  # fmt: skip


def alarm_clock(f: Form) -> list[Mesh]:
    """Return a round clock with hands, two bells and feet."""
    x, y, z = f.half
    radius = min(x, y * 0.4)
    middle = y * 0.48
    body = shifted(turned(drum(radius, -z, z * 0.9, f.main, sides=18), 90, axis=0), 0, middle, 0)
    face = shifted(
        turned(drum(radius * 0.84, z * 0.9, z, f.third, sides=18), 90, axis=0), 0, middle, 0
    )
    hands = [
        box(
            (-radius * 0.06, middle, z),
            (radius * 0.06, middle + radius * 0.62, z + 0.004),
            f.second,
        ),
        box(
            (0, middle - radius * 0.06, z),
            (radius * 0.5, middle + radius * 0.06, z + 0.004),
            f.second,
        ),
    ]
    parts = [body, face, *hands]
    for side in (-1, 1):
        parts.append(
            ball(
                (side * radius * 0.6, y * 0.9, 0),
                (radius * 0.36, y * 0.1, z * 0.5),
                f.second,
                sides=8,
                rings=5,
            )
        )
        parts.append(
            rod(
                (side * radius * 0.6, 0, 0),
                (side * radius * 0.4, y * 0.2, 0),
                radius * 0.1,
                f.second,
                sides=5,
            )
        )
    return parts


def watch(f: Form) -> list[Mesh]:
    """Return a wrist watch lying with its strap spread."""
    x, y, z = f.half
    r = min(x, z * 0.5)
    thick = max(y, 0.008)
    return [
        box((-x * 0.5, 0, -z), (x * 0.5, thick * 0.4, z), f.main),
        drum(r, 0, thick * 0.85, f.second),
        drum(r * 0.8, thick * 0.85, thick * 0.9, f.third),
        box((-r * 0.07, thick * 0.9, 0), (r * 0.07, thick, r * 0.6), (20.0, 20.0, 22.0)),
        box((0, thick * 0.9, -r * 0.07), (r * 0.45, thick, r * 0.07), (20.0, 20.0, 22.0)),
    ]


def vacuum(f: Form) -> list[Mesh]:
    """Return an upright vacuum cleaner."""
    x, y, z = f.half
    return [
        box((-x * 0.9, 0, z * 0.1), (x * 0.9, y * 0.1, z), f.second),
        turned(
            lathe(
                [
                    (0.0, y * 0.1),
                    (x * 0.5, y * 0.1),
                    (x * 0.55, y * 0.55),
                    (x * 0.3, y * 0.62),
                    (0.0, y * 0.62),
                ],
                [f.second, f.main, f.main, f.third],
            ),
            -8,
            axis=0,
        ),
        rod((0, y * 0.6, -z * 0.2), (0, y * 0.96, -z * 0.8), x * 0.08, f.third),
        *bent(
            [(0, y * 0.3, -z * 0.5), (x * 0.6, y * 0.5, -z * 0.6), (0, y * 0.9, -z * 0.75)],
            x * 0.06,
            f.second,
        ),
        ring((0, y * 0.94, -z * 0.75), x * 0.2, x * 0.09, f.main, axis=0),
    ]


BUILDERS: dict[str, Builder] = {
    "lamp": lamp,
    "candle": candle,
    "screen": screen,
    "device": device,
    "coffee_machine": coffee_machine,
    "toaster": toaster,
    "alarm_clock": alarm_clock,
    "watch": watch,
    "vacuum": vacuum,
}
