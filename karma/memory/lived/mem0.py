"""mem0-style: facts are extracted and the store is updated, one fact for each thing.

Chhikara et al. 2025, "Mem0: Building production-ready AI agents with scalable long-term memory"
(arXiv:2504.19413): a model extracts facts from each exchange and compares each with similar stored
ones: ADD, UPDATE, DELETE or NOOP. Here a sighting is a fact already, and "the same thing" is known
by its id, so no model decides: a new thing is ADD, another place or state is UPDATE, else NOOP.
"""

from collections.abc import Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace
from karma.memory.lived.setting import MemorySetting, sighting_text
from karma.memory.lived.texts import TextVectors, best_first


class Mem0Style:
    """A `HomeMemory` that keeps the newest fact about each thing.

    Args:
        setting: of the home.
    """

    name = "mem0-style"

    def __init__(self, setting: MemorySetting) -> None:
        self._places = setting.places
        self._texts = TextVectors(setting.embedder)
        self._facts: dict[str, tuple[int, Fact]] = {}  # by object: number of its text, and it
        self._row_bytes = 4 * setting.embedder.dimension

    def take_in(self, moment: HomeMoment) -> None:
        """Add what is new, and replace what has changed."""
        for seen in moment.seen:
            number = self._texts.number(sighting_text(seen, self._places))
            kept = self._facts.get(seen.object_id)
            if moment.deed is None and kept is not None and kept[0] == number:
                same_place = kept[1].sighting.place_id == seen.place_id
            else:
                same_place = False
            if same_place:
                continue  # NOOP: nothing new is said, and its time stays that of the change
            self._facts[seen.object_id] = (number, Fact(sighting=seen, deed=moment.deed))

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the facts nearest to the question."""
        if not self._facts:
            return ()
        near = self._texts.similarities(question)
        facts = list(self._facts.values())
        return [facts[at][1] for at in best_first([near[number] for number, _ in facts], k)]

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it has no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of the facts and a vector each."""
        return sum(
            len(sighting_text(fact.sighting, self._places)) + 24 + self._row_bytes
            for _, fact in self._facts.values()
        )

    def close(self) -> None:
        """Nothing is to be kept."""
