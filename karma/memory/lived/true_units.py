"""Ours within the paper's ten units: no log, and as many beliefs as there are lines."""

from collections.abc import Callable, Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion
from karma.memory.lived.setting import MemorySetting
from karma.memory.lived.true_memory import TrueMemory

HALF_LIFE = 60.0  # uses of all lines after which a use counts half
UNUSED = 0.2  # of a use, that a line is worth which was only seen


class TrueUnits(TrueMemory):
    """A `HomeMemory` that keeps the ten beliefs which are worth most.

    What it learns of how things move and where they go is kept, as the paper's map is.
    """

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._policy = NeedTruthCost(setting.units, self._worth)
        self._now_s = 0.0
        for belief in sorted(self._beliefs, key=lambda one: one.sighting.time_s):  # of a log
            self._now_s = max(self._now_s, belief.sighting.time_s)
            self._count(belief.sighting.object_id, self._policy.touch)

    def take_in(self, moment: HomeMoment) -> None:
        """Correct what is believed; then keep what is worth most."""
        self._now_s = moment.time_s
        super().take_in(moment)
        for seen in moment.seen:
            count = self._policy.use if moment.deed is not None else self._policy.touch
            self._count(seen.object_id, count)

    def _count(self, object_id: str, count: Callable[[str], str | None]) -> None:
        """Count a belief in; what leaves for it is forgotten."""
        leaves = count(object_id)
        if leaves is not None:
            self._beliefs.forget(leaves)
            self._log.drop(leaves)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what fits; what is told was needed."""
        found = super().recall(question, k)
        for fact in found[:1]:
            if fact.sighting.object_id in self._policy:
                self._policy.use(fact.sighting.object_id)
        return found

    def _worth(self, object_id: str) -> float:
        """Return the chance that a belief is true, times the looks that a search would take."""
        belief = self._beliefs.get(object_id)
        if belief is None or belief.ended_s is not None:
            return 0.0
        seen = belief.sighting
        shares = self._shares.of([object_id], seen.object_type)
        best = max(shares.values(), default=0.1)
        return self._beliefs.chance(belief, self._now_s) * (1.0 - best)


class NeedTruthCost:
    """Which key leaves a full memory, where another part knows what each is worth.

    A key's worth is the chance of being true times the cost of finding again; at least 0.
    """

    def __init__(self, capacity: int, worth: Callable[[str], float]) -> None:
        if capacity < 1:
            raise ValueError(f"a memory of {capacity} units")
        self._capacity, self._worth = capacity, worth
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
        if len(self._needs) <= self._capacity:
            return None
        leaves = min(self._needs, key=lambda one: (self._value(one), self._needs[one][1], one))
        self._past[leaves] = self._needs.pop(leaves)
        return leaves

    def _value(self, key: str) -> float:
        return self._aged(self._needs[key]) * self._worth(key)

    def _aged(self, need: tuple[float, int]) -> float:
        uses, when = need
        return float(uses * 0.5 ** ((self._clock - when) / HALF_LIFE))

    def __contains__(self, key: object) -> bool:
        return key in self._needs
