"""What usually lies where: P(receptacle type | object type), counted in rooms of our generator.

Stands for what the sources ask a large model (HELPER) or a trained network (CAPEAM). The rooms that
were counted are in no task; `scripts/make_likely_places.py` writes the table.
"""

from collections import Counter
from collections.abc import Mapping, MutableMapping
from functools import cache
from pathlib import Path

from karma.files import read_toml
from karma.household.pieces import base_type
from karma.household.types import object_type
from karma.household.uses import without_basin
from karma.world.core.scene import Scene

TABLE = Path(__file__).parent / "likely_places.toml"
_LEAST = 0.005  # smaller shares are left out


@cache
def _table() -> Mapping[str, Mapping[str, float]]:
    return read_toml(TABLE, dict[str, dict[str, float]])


def likely_places(kind: str) -> Mapping[str, float]:
    """Return receptacle type -> share, the likeliest first; empty for a type never counted.

    Raises:
        FileError: the table is damaged.
    """
    return _table().get(base_type(kind), {})


def count_places(scene: Scene, counts: MutableMapping[str, Counter[str]]) -> None:
    """Add one room: every thing that can be carried, by the furniture that it lies in or on."""
    by_id = {thing.id: thing for thing in scene.objects}
    for thing in scene.objects:
        place = thing
        while object_type(place.type).can("pickupable"):
            parents = [by_id[parent] for parent in place.parents]
            if not parents:
                break
            place = parents[0]
        if place is not thing and not object_type(place.type).can("pickupable"):
            counts.setdefault(thing.type, Counter())[without_basin(place.type)] += 1


def to_toml(counts: Mapping[str, Counter[str]]) -> str:
    """Return the table as text, types by name, places by share."""
    lines = ["# Written by scripts/make_likely_places.py: where our generator puts things.\n"]
    for kind in sorted(counts):
        total = counts[kind].total()
        shares = sorted(counts[kind].items(), key=lambda item: (-item[1], item[0]))
        words = (f"{place} = {n / total:.3f}" for place, n in shares if n / total >= _LEAST)
        lines.append(f"{kind} = {{ {', '.join(words)} }}\n")
    return "".join(lines)
