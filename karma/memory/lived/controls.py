"""Controls: no memory at all, and the last sighting of everything."""

from collections.abc import Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace
from karma.memory.lived.setting import MemorySetting


class NoMemory:
    """A `HomeMemory` that keeps nothing: every thing has to be searched for."""

    name = "no memory"

    def __init__(self, setting: MemorySetting) -> None:
        pass

    def take_in(self, moment: HomeMoment) -> None:
        """Forget it."""

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return nothing."""
        return ()

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing."""
        return ()

    def size_bytes(self) -> int:
        """Return 0."""
        return 0

    def close(self) -> None:
        """Nothing is kept."""


class LastSeen:
    """A `HomeMemory` that keeps where everything was seen last: what a sceptic would ask for.

    It has no limit, no notion of age, and what is not where it was stays where it was.

    Args:
        setting: of the home.
    """

    name = "last seen"

    def __init__(self, setting: MemorySetting) -> None:
        self._facts: dict[str, Fact] = {}

    def take_in(self, moment: HomeMoment) -> None:
        """Overwrite what was known of everything in view."""
        for seen in moment.seen:
            old = self._facts.get(seen.object_id)
            deed = moment.deed if moment.deed is not None or old is None else old.deed
            self._facts[seen.object_id] = Fact(sighting=seen, deed=deed)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the facts about the types that may be meant, the likelier type first."""
        ranks = {meaning.name: rank for rank, meaning in enumerate(question.thing.types)}
        facts = [
            fact for fact in self._facts.values() if not ranks or fact.sighting.object_type in ranks
        ]
        facts.sort(key=lambda one: (ranks.get(one.sighting.object_type, 0), -one.sighting.time_s))
        return facts[:k]

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it has no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of one line per thing."""
        return 96 * len(self._facts)

    def close(self) -> None:
        """Nothing is to be kept."""
