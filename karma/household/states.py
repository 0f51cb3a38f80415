"""State words: which end one another, and which stand for the goals and skills that bring them."""

from collections.abc import Mapping
from types import MappingProxyType

_PAIRS = (("opened", "closed"), ("on", "off"), ("dirty", "cleaned"))
OPPOSITES: Mapping[str, str] = MappingProxyType(
    {one: other for a, b in _PAIRS for one, other in ((a, b), (b, a))}
)  # a state ends when its opposite comes
DOOR_AFTER: Mapping[str, str] = MappingProxyType({"OpenObject": "opened", "CloseObject": "closed"})
END_STATES: Mapping[str, str] = MappingProxyType(
    {"TOGGLEON": "on", "TOGGLEOFF": "off", "OPEN": "opened", "CLOSED": "closed"}
)  # what a predicate of a goal asks for
