"""Object ids: what type an id speaks of, what it was cut from, what is a part of what.

AI2-THOR writes `Mug|x|y|z`, and in houses `Mug|surface|2|1`; a part or a piece has its own name
behind the whole's id: `Sink|x|y|z|SinkBasin`, `Apple|2|0|AppleSliced_2`. A type alone may stand for
an id everywhere.
"""

from karma.types.space import Vec3


def _sections(object_id: str) -> tuple[list[str], list[str]]:
    """Return the sections of a whole's id, and the names of parts behind them."""
    first, *rest = object_id.split("|")
    whole = next((n for n, one in enumerate(rest) if one[:1].isupper()), len(rest))
    return [first, *rest[:whole]], rest[whole:]


def type_of(object_id: str | None) -> str:
    """Return the type of the object that an id names, "" for none.

    >>> type_of("Mug"), type_of("Sink|+01.00|+00.90|-02.00|SinkBasin"), type_of(None)
    ('Mug', 'SinkBasin', '')
    >>> type_of("Apple|+01.00|+00.90|-02.00|AppleSliced_2"), type_of("Apple|surface|2|1")
    ('AppleSliced', 'Apple')
    """
    whole, parts = _sections(object_id or "")
    return parts[-1].partition("_")[0] if parts else whole[0]


def is_id(name: str) -> bool:
    """Return whether a name is an id, not a type.

    >>> is_id("Mug"), is_id("Mug|+01.00|+00.90|-02.00")
    (False, True)
    """
    return "|" in name


def root_type(object_id: str) -> str:
    """Return the type of the whole that an id begins with: a basin's sink, a slice's apple.

    >>> root_type("Mug"), root_type("Sink|+01.00|+00.90|-02.00|SinkBasin")
    ('Mug', 'Sink')
    """
    return object_id.partition("|")[0]


def root_id(object_id: str) -> str:
    """Return the id of the whole that an id begins with: its type and place.

    >>> root_id("Sink|+01.00|+00.90|-02.00|SinkBasin"), root_id("Mug|+01.00|+00.90|-02.00")
    ('Sink|+01.00|+00.90|-02.00', 'Mug|+01.00|+00.90|-02.00')
    """
    return "|".join(_sections(object_id)[0])


def whole_id(object_id: str) -> str:
    """Return the id of what a piece was cut from, or what a part is a part of.

    >>> whole_id("Apple|+01.00|+00.90|-02.00|AppleSliced_2")
    'Apple|+01.00|+00.90|-02.00'
    """
    return object_id.rpartition("|")[0]


def part_id(object_id: str, part: str) -> str:
    """Return the id of a part or piece of an object.

    >>> part_id("Sink|+01.00|+00.90|-02.00", "SinkBasin")
    'Sink|+01.00|+00.90|-02.00|SinkBasin'
    """
    return f"{object_id}|{part}"


def is_part(object_id: str, of: str) -> bool:
    """Return whether an id is that of a part or piece of another object.

    >>> is_part("Apple|1|2|3|AppleSliced_2", of="Apple|1|2|3"), is_part("Mug|1", of="Mug|1")
    (True, False)
    """
    return object_id.startswith(f"{of}|")


def made_at(object_id: str) -> Vec3 | None:
    """Return the position that an id carries, metres to the centimetre; None if it has none.

    >>> made_at("Mug|+01.00|+00.90|-02.50"), made_at("Mug")
    ((1.0, 0.9, -2.5), None)
    """
    try:
        x, y, z = map(float, object_id.split("|")[1:4])
    except ValueError:
        return None
    return (x, y, z)


def short_type(name: str) -> str:
    """Return the type of a prompt's short name.

    >>> short_type("Apple_2"), short_type("Apple")
    ('Apple', 'Apple')
    """
    return name.partition("_")[0]


def is_position(argument: str) -> bool:
    """Return whether an argument is a place "(x, y, z)" in metres instead of a name."""
    return argument.startswith("(")
