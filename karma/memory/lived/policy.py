"""A replacement policy that weighs need, truth and cost: what is kept is what saves most.

A line is worth the chance that it is needed soon, times the chance that it is still true, times
what finding the thing again would cost. Need is counted from uses, the older ones halved with every
`HALF_LIFE` uses of any line; truth and cost are asked of the memory that the policy serves.
"""

from collections.abc import Callable, Iterator

HALF_LIFE = 60.0  # uses of all lines after which a use counts half
UNUSED = 0.2  # of a use, that a line is worth which was only seen


class NeedTruthCost:
    """A `ReplacementPolicy` over keys whose worth another part knows.

    Args:
        capacity: lines, at least 1.
        worth: chance of being true times cost of finding again, by key; at least 0.
    """

    def __init__(self, capacity: int, worth: Callable[[str], float]) -> None:
        if capacity < 1:
            raise ValueError(f"a memory of {capacity} units")
        self.capacity = capacity
        self._worth = worth
        self._needs: dict[str, tuple[float, int]] = {}  # of residents: uses, and when last halved
        self._past: dict[str, tuple[float, int]] = {}  # of those that left
        self._clock = 0

    def touch(self, key: str) -> str | None:
        """Record that a thing was seen; return the key that left, which may be `key` itself."""
        return self._counted(key, UNUSED)

    def use(self, key: str) -> str | None:
        """Record that a thing was needed: asked for, or handled."""
        return self._counted(key, 1.0)

    def _counted(self, key: str, uses: float) -> str | None:
        self._clock += 1
        old = self._needs.pop(key, None) or self._past.pop(key, (0.0, self._clock))
        self._needs[key] = (self._aged(old) + uses, self._clock)
        if len(self._needs) <= self.capacity:
            return None
        leaves = min(self._needs, key=lambda one: (self.value(one), self._needs[one][1], one))
        self._past[leaves] = self._needs.pop(leaves)
        return leaves

    def value(self, key: str) -> float:
        """Return what a resident line is worth now."""
        return self._aged(self._needs[key]) * self._worth(key)

    def _aged(self, need: tuple[float, int]) -> float:
        uses, when = need
        return float(uses * 0.5 ** ((self._clock - when) / HALF_LIFE))

    def discard(self, key: str) -> None:
        """Free the line of a key, if it has one."""
        self._needs.pop(key, None)

    def __contains__(self, key: object) -> bool:
        return key in self._needs

    def __len__(self) -> int:
        return len(self._needs)

    def __iter__(self) -> Iterator[str]:
        return iter(self._needs)
