"""The paper's memory: ten units of what was handled, and a map of furniture (KARMA §3.4-3.6).

A unit enters when its thing is handled, by the robot or before its eyes. What is only seen on
rounds would flush ten units many times a day; with it the rows are worse (0.31, not 0.34).
Nothing evicts a unit that has become false: "if the memory is incorrect, there is no mechanism
designed for eviction or updating" (§6). The map is of immovable things, so it answers no question
here by itself.
"""

from collections.abc import Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace, MemoryUnit, Sighting
from karma.memory.lived.setting import MemorySetting, sighting_text
from karma.memory.lived.texts import TextVectors, best_first
from karma.memory.policies import make_policy
from karma.memory.short_term import ShortTermMemory


class KarmaUnits:
    """A `HomeMemory` of ten units under one replacement policy.

    Args:
        setting: of the home.
        policy: in the paper's notation.
    """

    name = "KARMA"

    def __init__(self, setting: MemorySetting, policy: str) -> None:
        self._places = setting.places
        self._texts = TextVectors(setting.embedder)
        self._units = ShortTermMemory(make_policy(policy))
        self._facts: dict[str, Fact] = {}

    def take_in(self, moment: HomeMoment) -> None:
        """Remember what was handled."""
        if moment.deed is None:
            return
        for seen in moment.seen:
            left = self._units.remember(_unit(seen))
            self._facts[seen.object_id] = Fact(sighting=seen, deed=moment.deed)
            if left is not None:
                self._facts.pop(left.object_id, None)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the units nearest to the question."""
        facts = [self._facts[unit.object_id] for unit in reversed(self._units.units())]
        if not facts:
            return ()
        numbers = [self._texts.number(sighting_text(one.sighting, self._places)) for one in facts]
        near = self._texts.similarities(question)
        return [facts[at] for at in best_first([near[number] for number in numbers], k)]

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: its map is searched in the order of areas."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of the units."""
        return sum(
            len(sighting_text(fact.sighting, self._places)) + 24 for fact in self._facts.values()
        )

    def close(self) -> None:
        """Nothing is to be kept."""


class KarmaUnitsFifo(KarmaUnits):
    """The paper's FIFO with merging."""

    name = "KARMA, FIFO"

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting, f"fifo-merge[{setting.units}]")


class KarmaUnitsLru(KarmaUnits):
    """The same units, of which the least recently handled leaves."""

    name = "KARMA, LRU"

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting, f"lru[{setting.units}]")


class KarmaUnitsWTinyLfu(KarmaUnits):
    """The paper's W-TinyLFU, window 9 and main 1 at ten units."""

    name = "KARMA, W-TinyLFU"

    def __init__(self, setting: MemorySetting) -> None:
        window = max(setting.units - 1, 1)
        super().__init__(setting, f"wtinylfu-karma[{window},{setting.units - window}]")


def _unit(seen: Sighting) -> MemoryUnit:
    return MemoryUnit(
        object_id=seen.object_id,
        object_type=seen.object_type,
        position_m=seen.position_m,
        states=seen.states,
        place_id=seen.place_id,
        handled=True,
    )
