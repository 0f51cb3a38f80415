"""The usual RAG: every sighting is appended, the K texts nearest to the question come back.

Lewis et al. 2020, "Retrieval-augmented generation for knowledge-intensive NLP tasks", over the
robot's own observations. Rows of equal text tie, and the newest of them comes first.
"""

from collections.abc import Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace
from karma.memory.lived.setting import MemorySetting, sighting_text
from karma.memory.lived.texts import TextVectors, best_first


class AppendOnly:
    """A `HomeMemory` that forgets nothing and corrects nothing.

    Args:
        setting: of the home.
    """

    name = "append-only RAG"

    def __init__(self, setting: MemorySetting) -> None:
        self._places = setting.places
        self._texts = TextVectors(setting.embedder)
        self._rows: list[list[Fact]] = []  # of each text, in order of time
        self._bytes = 0
        self._row_bytes = 4 * setting.embedder.dimension

    def take_in(self, moment: HomeMoment) -> None:
        """Append a row for everything in view."""
        for seen in moment.seen:
            text = sighting_text(seen, self._places)
            number = self._texts.number(text)
            if number == len(self._rows):
                self._rows.append([])
            self._rows[number].append(Fact(sighting=seen, deed=moment.deed))
            self._bytes += len(text) + 24 + self._row_bytes

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the rows of the nearest texts."""
        if not self._rows:
            return ()
        found: list[Fact] = []
        for number in best_first(self._texts.similarities(question), k):
            found += reversed(self._rows[number][-(k - len(found)) :])
            if len(found) >= k:
                break
        return found[:k]

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it has no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of texts, times and vectors, each row with its own."""
        return self._bytes

    def close(self) -> None:
        """Nothing is to be kept."""
