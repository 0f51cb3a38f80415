"""Write AI2-THOR's object ids exactly as the simulator that ALFRED was recorded on did."""

import struct
from decimal import ROUND_HALF_EVEN, ROUND_HALF_UP, Context, Decimal

from karma.contracts import Vec3
from karma.household.types import object_types

# types that AI2-THOR renamed or dropped after ALFRED was recorded
_RENAMED = {
    "Cart": "ShelvingUnit", "Glassbottle": "Bottle", "PaperTowel": "PaperTowelRoll",
    "ToiletPaperRoll": "ToiletPaper",
}  # fmt: skip
_SEVEN_DIGITS = Context(prec=7, rounding=ROUND_HALF_EVEN)
_CENT = Decimal("0.01")


def object_id(kind: str, position: Vec3) -> str:
    """Return the id of an object that spawned at a position, metres.

    The simulator holds a coordinate as a 32-bit float, takes its text of 7 significant digits, and
    rounds that to 2 decimals, halves away from zero; what rounds to zero from below has no sign.

    >>> object_id("Apple", (-0.465, 1.125, -0.0049))
    'Apple|-00.47|+01.13|00.00'
    """
    return "|".join([kind, *map(_coordinate, position)])


def _coordinate(value: float) -> str:
    single = struct.unpack("f", struct.pack("f", value))[0]
    rounded = _SEVEN_DIGITS.create_decimal_from_float(single).quantize(_CENT, ROUND_HALF_UP)
    digits = f"{abs(rounded):05.2f}"
    if value >= 0:
        return f"+{digits}"
    return f"-{digits}" if rounded else digits


def spelt_out(name: str) -> str:
    """Return the id of what a side file names by type and exact place only, e.g. `Type@[x, y, z]`.

    >>> spelt_out("Shelf@[-1.029, 1.529, -1.593]"), spelt_out("Bed|+00.00|+00.10|+01.00")
    ('Shelf|-01.03|+01.53|-01.59', 'Bed|+00.00|+00.10|+01.00')
    """
    kind, at, rest = name.partition("@")
    try:
        x, y, z = map(float, rest.strip("[]").split(","))
    except ValueError:
        return name
    return object_id(kind, (x, y, z)) if at else name


def names_then() -> frozenset[str]:
    """Return the types that ALFRED's ids may begin with: ours, and those renamed since."""
    return frozenset((*object_types(), *_RENAMED))


def type_now(kind: str) -> str | None:
    """Return the name that AI2-THOR 5.0.0 has for a type of ALFRED; None if it has none.

    >>> type_now("Glassbottle"), type_now("Apple"), type_now("LaundryHamperLid")
    ('Bottle', 'Apple', None)
    """
    name = _RENAMED.get(kind, kind)
    return name if name in object_types() else None
