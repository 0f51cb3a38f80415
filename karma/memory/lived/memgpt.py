"""MemGPT-style: a small main context, and an archive that is paged in by search.

Packer et al. 2023, "MemGPT: Towards LLMs as operating systems" (arXiv:2310.08560): the model edits
a fixed main context and pages from recall and archival storage by function calls. Here the main
context has the setting's number of units, one per thing, the oldest goes to the archive, and one
page of the archive is searched for every question, as no model decides when to.
"""

from collections import OrderedDict
from collections.abc import Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace
from karma.memory.lived.setting import MemorySetting, sighting_text
from karma.memory.lived.texts import TextVectors, best_first


class MemGptStyle:
    """A `HomeMemory` with a first-in-first-out context over an append-only archive.

    Args:
        setting: of the home; `units` is the size of the main context.
    """

    name = "MemGPT-style"

    def __init__(self, setting: MemorySetting) -> None:
        self._places, self._units = setting.places, setting.units
        self._texts = TextVectors(setting.embedder)
        self._main: OrderedDict[str, tuple[int, Fact]] = OrderedDict()
        self._archive: list[tuple[int, Fact]] = []
        self._row_bytes = 4 * setting.embedder.dimension

    def take_in(self, moment: HomeMoment) -> None:
        """Write into the main context; what falls out of it, or is overwritten, is archived."""
        for seen in moment.seen:
            number = self._texts.number(sighting_text(seen, self._places))
            old = self._main.pop(seen.object_id, None)
            if old is not None and (old[0] != number or old[1].deed is not None):
                self._archive.append(old)
            self._main[seen.object_id] = (number, Fact(sighting=seen, deed=moment.deed))
            if len(self._main) > self._units:
                self._archive.append(self._main.popitem(last=False)[1])

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the main context by nearness, then a page of the archive."""
        if not self._texts:
            return ()
        near = self._texts.similarities(question)
        main = list(self._main.values())
        first = [main[at][1] for at in best_first([near[number] for number, _ in main], k)]
        newest = list(reversed(self._archive))
        page = best_first([near[number] for number, _ in newest], max(k - len(first), 0))
        return [*first, *(newest[at][1] for at in page)]

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it has no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of context and archive, a vector each."""
        rows = [*self._main.values(), *self._archive]
        return sum(
            len(sighting_text(fact.sighting, self._places)) + 24 + self._row_bytes
            for _, fact in rows
        )

    def close(self) -> None:
        """Nothing is to be kept."""
