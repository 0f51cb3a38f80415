"""Refuse the actions of AI2-THOR that the embedded world leaves out (`left_out.toml`)."""

from collections.abc import Callable
from pathlib import Path

from msgspec import Struct

from karma.files import read_toml
from karma.world.core.state import Refusal, Result, WorldState

TABLE = Path(__file__).with_name("left_out.toml")


class _Group(Struct, frozen=True, forbid_unknown_fields=True):
    reason: str
    names: tuple[str, ...]


class _LeftOut(Struct, frozen=True, forbid_unknown_fields=True):
    group: tuple[_Group, ...]


def reasons_left_out() -> dict[str, str]:
    """Return why each action is left out, by name.

    Raises:
        FileError: the table is damaged.
    """
    table = read_toml(TABLE, _LeftOut)
    return {name: group.reason for group in table.group for name in group.names}


def refuser(name: str, reason: str) -> Callable[..., Result]:
    """Return the action that says that it is left out, and why."""

    def left_out(state: WorldState) -> Result:
        return Refusal(f"{name} is not part of the embedded world: {reason}.")

    return left_out
