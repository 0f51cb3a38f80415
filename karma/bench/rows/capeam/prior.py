"""What usually lies where: P(receptacle type | object type), counted in rooms of our generator.

Stands for what the sources ask a large model (HELPER) or a trained network (CAPEAM). The rooms that
were counted are in no task; what counted them is in the history, at commit cb939ce.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from karma.files import read_toml
from karma.household.pieces import base_type

TABLE = Path(__file__).parent / "likely_places.toml"


@cache
def _table() -> Mapping[str, Mapping[str, float]]:
    return read_toml(TABLE, dict[str, dict[str, float]])


def likely_places(kind: str) -> Mapping[str, float]:
    """Return receptacle type -> share, the likeliest first; empty for a type never counted.

    Raises:
        FileError: the table is damaged.
    """
    return _table().get(base_type(kind), {})
