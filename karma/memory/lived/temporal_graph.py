"""Graphiti / Zep style: a temporal graph whose edges have intervals of validity.

Rasmussen et al. 2025, "Zep: a temporal knowledge graph architecture for agent memory"
(arXiv:2501.13956): entities and edges with the time from which a fact holds and the time at which
it was invalidated by a newer one; search by cosine and by words, merged by reciprocal rank. Here
entities are known by their ids, so no model resolves them, and an edge holds a thing's place and
states. Only edges that were valid at the asked time come back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from karma.contracts import Deed, Fact, HomeMoment, HomeQuestion, LikelyPlace, Sighting
from karma.memory.lived.setting import MemorySetting, sighting_text
from karma.memory.lived.texts import TextVectors, best_first

_RANK = 60.0  # of reciprocal rank fusion, as usual


@dataclass(slots=True)
class _Edge:
    text: int
    sighting: Sighting  # the last that confirmed it
    valid_s: float
    invalid_s: float | None = None
    deed: Deed | None = None  # that it came about by


class TemporalGraph:
    """A `HomeMemory` of edges that newer ones invalidate; none is thrown away.

    Args:
        setting: of the home.
    """

    name = "temporal graph (Zep-style)"

    def __init__(self, setting: MemorySetting) -> None:
        self._places = setting.places
        self._texts = TextVectors(setting.embedder)
        self._edges: list[_Edge] = []
        self._current: dict[str, _Edge] = {}
        self._row_bytes = 4 * setting.embedder.dimension

    def take_in(self, moment: HomeMoment) -> None:
        """Confirm edges, or add new ones and end those that they contradict."""
        for seen in moment.seen:
            number = self._texts.number(sighting_text(seen, self._places))
            edge = self._current.get(seen.object_id)
            same = (
                edge is not None
                and edge.text == number
                and edge.sighting.place_id == seen.place_id
                and moment.deed is None
            )
            if edge is not None and same:
                edge.sighting = seen
                continue
            if edge is not None:
                edge.invalid_s = seen.time_s
            new = _Edge(text=number, sighting=seen, valid_s=seen.time_s, deed=moment.deed)
            self._edges.append(new)
            self._current[seen.object_id] = new

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return edges valid at the asked time, by cosine and by the names of entities."""
        said = question.thing
        past = said.before_s is not None or said.who or said.action
        edges = [edge for edge in self._edges if self._valid(edge, question)]
        if not edges:
            return ()
        near = self._texts.similarities(question)
        names = {meaning.name: 1.0 / (1 + rank) for rank, meaning in enumerate(said.types)}
        cosine = np.array([near[edge.text] for edge in edges])
        words = np.array(
            [
                names.get(edge.sighting.object_type, 0.0)
                + (0.5 if edge.deed and said.who and edge.deed.who == said.who else 0.0)
                for edge in edges
            ]
        )
        fused = np.zeros(len(edges))
        for scores in (cosine, words):
            ranks = np.argsort(np.argsort(-scores, kind="stable"), kind="stable")
            fused += np.where(scores > 0, 1.0 / (_RANK + ranks), 0.0)
        return [self._fact(edges[at], bool(past)) for at in best_first(fused.tolist(), k)]

    def _valid(self, edge: _Edge, question: HomeQuestion) -> bool:
        said = question.thing
        if said.who or said.action or question.asked in ("time", "who"):
            return True  # an event is over: its edge may have ended
        if said.before_s is None:
            return edge.invalid_s is None
        after = said.after_s if said.after_s is not None else said.before_s
        return edge.valid_s <= said.before_s and (edge.invalid_s is None or edge.invalid_s > after)

    @staticmethod
    def _fact(edge: _Edge, past: bool) -> Fact:
        seen = replace(edge.sighting, time_s=edge.valid_s) if past else edge.sighting
        return Fact(sighting=seen, deed=edge.deed, ended_s=None if past else edge.invalid_s)

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it has no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of all edges with a vector each."""
        return sum(
            len(sighting_text(edge.sighting, self._places)) + 40 + self._row_bytes
            for edge in self._edges
        )

    def close(self) -> None:
        """Nothing is to be kept."""
