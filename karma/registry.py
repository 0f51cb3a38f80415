"""Name -> implementation, by entry point: lazy, and loud about unknown names."""

from difflib import get_close_matches
from importlib.metadata import entry_points
from typing import Any

from karma.errors import UnknownNameError


def names(role: str) -> list[str]:
    """Return the registered names of a role ("policies", "worlds", ...), sorted."""
    return sorted(ep.name for ep in entry_points(group=f"karma.{role}"))


def load(role: str, name: str) -> Any:
    """Return the object registered as `name` under `role`.

    Raises:
        UnknownNameError: nothing has that name; the message suggests the nearest one. Or what is
            installed under it is no longer there.
    """
    found = {ep.name: ep for ep in entry_points(group=f"karma.{role}")}
    if name not in found:
        near = get_close_matches(name, found, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(f"no {role} named {name!r}.{hint} Installed: {sorted(found)}")
    try:
        return found[name].load()
    except (AttributeError, ModuleNotFoundError) as error:
        said = f"{role} {name!r} is installed as {found[name].value}: {error}"
        raise UnknownNameError(f"{said}\n  To fix: make setup") from error
