"""The memory designs of others and the controls, as rows of one table.

What each keeps, and how it finds it again, is written anew from its paper; where it deviates is in
docs/plugins/homes-methods.md. None knows how likely a fact still holds, or where to look.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.household.types import in_words
from karma.memory.policies import make_policy
from karma.plugins.homes.memory.setting import MemorySetting, is_said_place, ranks_of, sighting_text
from karma.plugins.homes.memory.true_memory import TrueMemory, TrueUnits
from karma.plugins.homes.types import (
    Deed,
    Fact,
    HomeMemory,
    HomeMoment,
    HomeQuestion,
    LikelyPlace,
    Sighting,
)
from karma.types.roles import Embedder
from karma.types.space import Vectors


class TextVectors:
    """Texts numbered as they come, each embedded once; exact search over all of them."""

    def __init__(self, embedder: Embedder) -> None:
        self._embedder = embedder
        self._numbers: dict[str, int] = {}
        self._rows: list[Vectors] = []

    def number(self, text: str) -> int:
        """Return the number of a text; a new one gets the next."""
        if text not in self._numbers:
            self._numbers[text] = len(self._rows)
            self._rows.append(self._embedder.embed([text]))
        return self._numbers[text]

    def similarities(self, question: HomeQuestion) -> NDArray[np.float32]:
        """Return each text's cosine with the question, shape (texts,)."""
        asked = self._embedder.embed([query_text(question)])
        found: NDArray[np.float32] = np.concatenate(self._rows) @ asked[0]
        return found


def query_text(question: HomeQuestion) -> str:
    """Return what a design looks up: the noun phrase, and the names of the nearest types.

    All designs get the same, so that none loses for not knowing a word.
    """
    said = question.thing
    names = [in_words(meaning.name) for meaning in said.types[:2]]
    return ", ".join(dict.fromkeys([said.phrase or question.text, *names]))


def best_first(scores: NDArray[np.floating[Any]], k: int) -> NDArray[np.intp]:
    """Return the numbers of the k best scores, the earlier of equals first."""
    return np.argsort(-scores, kind="stable")[:k]


CAPTIONS = 6  # that each search of ReMEmbR returns
_IN_CAPTION = 8  # things that a caption names
_RANK = 60.0  # of reciprocal rank fusion, as usual


@dataclass(slots=True)
class _StoredFact:
    """A fact as designs store it."""

    fact: Fact
    text: int  # number of its words
    size: int  # bytes of its words
    since_s: float  # when it came about
    ended_s: float | None = None  # when a newer one took its place

    @property
    def seen(self) -> Sighting:
        """Where the thing was."""
        return self.fact.sighting

    def says(self, new: "_StoredFact") -> bool:
        """Return whether a new row tells nothing else: no deed, the same words and place."""
        same_place = self.seen.place_id == new.seen.place_id
        return new.fact.deed is None and self.text == new.text and same_place


class NoMemory:
    """A `HomeMemory` that keeps nothing; the other designs say what they keep, how they rank."""

    row_bytes = 24  # of a row, beside its words: a time and numbers; vectors come to that

    def __init__(self, setting: MemorySetting) -> None:
        self._places, self._most = setting.places, setting.units
        self._texts = TextVectors(setting.embedder)
        self._vector_bytes = 4 * setting.embedder.dimension

    def take_in(self, moment: HomeMoment) -> None:
        """Store a row for everything in view."""
        for seen in moment.seen:
            self._store(self._row(seen, moment.deed))

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the facts whose words are nearest to the question."""
        return self._nearest(list(self._rows()), question, k)

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of words, times and vectors, as each row would have them."""
        return sum(one.size + self.row_bytes + self._vector_bytes for one in self._rows())

    def close(self) -> None:
        """Nothing is to be kept."""

    def _store(self, new: _StoredFact) -> None:
        """Keep a row, or not."""

    def _rows(self) -> Iterable[_StoredFact]:
        """Return what is kept, the first of equals first."""
        return ()

    def _row(self, seen: Sighting, deed: Deed | None) -> _StoredFact:
        text = sighting_text(seen, self._places)
        fact, number = Fact(sighting=seen, deed=deed), self._texts.number(text)
        return _StoredFact(fact=fact, text=number, size=len(text), since_s=seen.time_s)

    def _nearest(self, rows: Sequence[_StoredFact], question: HomeQuestion, k: int) -> list[Fact]:
        if not rows:
            return []
        near = self._texts.similarities(question)
        return [rows[at].fact for at in best_first(near[[one.text for one in rows]], k)]


class LastSeen(NoMemory):
    """The last sighting of everything, by type: what a sceptic would ask for.

    No limit, no age, no vectors; what is not where it was stays where it was.
    """

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._facts: dict[str, Fact] = {}

    def take_in(self, moment: HomeMoment) -> None:
        """Overwrite what was known of everything in view."""
        for seen in moment.seen:
            old = self._facts.get(seen.object_id)
            deed = moment.deed if moment.deed is not None or old is None else old.deed
            self._facts[seen.object_id] = Fact(sighting=seen, deed=deed)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the facts about the types that may be meant, the likelier type first."""
        ranks = ranks_of(question.thing)
        seen = self._facts.values()
        facts = [fact for fact in seen if not ranks or fact.sighting.object_type in ranks]
        facts.sort(key=lambda one: (ranks.get(one.sighting.object_type, 0), -one.sighting.time_s))
        return facts[:k]

    def size_bytes(self) -> int:
        """Return bytes of one line per thing."""
        return 96 * len(self._facts)


class AppendOnly(NoMemory):
    """The usual RAG (Lewis et al. 2020): every sighting is appended, none is corrected.

    Rows of equal text tie, and the newest of them comes first.
    """

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._by_text: list[list[_StoredFact]] = []  # in order of time

    def _store(self, new: _StoredFact) -> None:
        if new.text == len(self._by_text):
            self._by_text.append([])
        self._by_text[new.text].append(new)

    def _rows(self) -> Iterable[_StoredFact]:
        return chain.from_iterable(self._by_text)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the rows of the nearest texts."""
        if not self._by_text:
            return ()
        found: list[Fact] = []
        for number in best_first(self._texts.similarities(question), k):
            found += (one.fact for one in self._by_text[number][: -k - 1 : -1])
            if len(found) >= k:
                break
        return found[:k]


class Mem0Style(NoMemory):
    """mem0 (Chhikara et al. 2025, arXiv:2504.19413): one fact a thing, added, updated or left.

    What says nothing new is a NOOP: the time of the fact stays that of the change.
    """

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._facts: dict[str, _StoredFact] = {}  # by object

    def _store(self, new: _StoredFact) -> None:
        old = self._facts.get(new.seen.object_id)
        if old is None or not old.says(new):
            self._facts[new.seen.object_id] = new

    def _rows(self) -> Iterable[_StoredFact]:
        return self._facts.values()


class MemGptStyle(NoMemory):
    """MemGPT (Packer et al. 2023, arXiv:2310.08560): a context of `units`, and an archive.

    What falls out of the context, or is overwritten there, goes to the archive; every question gets
    the context first, then one page of the archive.
    """

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._context: dict[str, _StoredFact] = {}  # by object, the last seen last
        self._archive: list[_StoredFact] = []

    def _store(self, new: _StoredFact) -> None:
        old = self._context.pop(new.seen.object_id, None)
        if old is not None and (old.text != new.text or old.fact.deed is not None):
            self._archive.append(old)
        self._context[new.seen.object_id] = new
        if len(self._context) > self._most:
            self._archive.append(self._context.pop(next(iter(self._context))))

    def _rows(self) -> Iterable[_StoredFact]:
        return (*self._context.values(), *self._archive)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return the context by nearness, then a page of the archive, the newest first."""
        first = self._nearest(list(self._context.values()), question, k)
        return first + self._nearest(self._archive[::-1], question, k - len(first))


class KarmaUnits(NoMemory):
    """KARMA's short-term memory (§3.4-3.6): a unit for each thing that was handled, under a policy.

    What is only seen on rounds would flush ten units many times a day. Nothing evicts a unit that
    has become false (§6). The map is of immovable things, and answers nothing here by itself.

    The policy is in the paper's notation, for {0} lines, or {1} of a window and {2} beside it.
    """

    def __init__(self, setting: MemorySetting, policy: str) -> None:
        super().__init__(setting)
        window = max(self._most - 1, 1)
        self._policy = make_policy(policy.format(self._most, window, self._most - window))
        self._units: dict[str, _StoredFact] = {}  # by object, the last handled first
        self._vector_bytes = 0

    def take_in(self, moment: HomeMoment) -> None:
        """Remember what was handled."""
        if moment.deed is not None:
            super().take_in(moment)

    def _store(self, new: _StoredFact) -> None:
        self._units = {new.seen.object_id: new} | {
            key: one for key, one in self._units.items() if key != new.seen.object_id
        }
        left = self._policy.touch(new.seen.object_id)
        if left is not None and left not in self._policy:
            del self._units[left]

    def _rows(self) -> Iterable[_StoredFact]:
        return self._units.values()


class TemporalGraph(NoMemory):
    """Zep, Graphiti (Rasmussen et al. 2025, arXiv:2501.13956): facts with intervals of validity.

    An edge holds a thing's place and states until a newer one contradicts it; none is thrown away.
    Edges that were valid at the asked time are found by cosine and by names, fused by rank.
    """

    row_bytes = 40

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._edges: list[_StoredFact] = []
        self._current: dict[str, _StoredFact] = {}  # by object

    def _store(self, new: _StoredFact) -> None:
        edge = self._current.get(new.seen.object_id)
        if edge is not None and edge.says(new):
            edge.fact = replace(edge.fact, sighting=new.seen)
            return
        if edge is not None:
            edge.ended_s = new.since_s
        self._edges.append(new)
        self._current[new.seen.object_id] = new

    def _rows(self) -> Iterable[_StoredFact]:
        return self._edges

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return edges valid at the asked time, by cosine and by the names of entities."""
        said = question.thing
        past = bool(said.before_s is not None or said.who or said.action)
        edges = [edge for edge in self._edges if _valid(edge, question)]
        if not edges:
            return ()
        names = {name: 1.0 / (1 + rank) for name, rank in ranks_of(said).items()}
        cosine = self._texts.similarities(question)[[edge.text for edge in edges]]
        words = [
            names.get(edge.seen.object_type, 0.0)
            + 0.5 * bool(said.who and edge.fact.deed and edge.fact.deed.who == said.who)
            for edge in edges
        ]
        fused = np.zeros(len(edges))
        for scores in (cosine, np.array(words)):
            ranks = np.argsort(np.argsort(-scores, kind="stable"), kind="stable")
            fused += np.where(scores > 0, 1.0 / (_RANK + ranks), 0.0)
        return [_fact_of(edges[at], past) for at in best_first(fused, k)]


def _valid(edge: _StoredFact, question: HomeQuestion) -> bool:
    said = question.thing
    if said.who or said.action or question.asked in ("time", "who"):
        return True  # an event is over: its edge may have ended
    if said.before_s is None:
        return edge.ended_s is None
    after = said.after_s if said.after_s is not None else said.before_s
    return edge.since_s <= said.before_s and (edge.ended_s is None or edge.ended_s > after)


def _fact_of(edge: _StoredFact, past: bool) -> Fact:
    if past:
        return replace(edge.fact, sighting=replace(edge.seen, time_s=edge.since_s))
    return replace(edge.fact, ended_s=edge.ended_s)


@dataclass(frozen=True, slots=True)
class _Caption:
    """What one view shows, written without a model."""

    time_s: float
    rows: tuple[_StoredFact, ...]  # of what it names
    place_ids: frozenset[str]  # of all that is in view


class ReMEmbRStyle(NoMemory):
    """ReMEmbR (Anwar et al. 2024, arXiv:2409.13682): captions found by text, by place and by time.

    The question's own fields choose the searches, each made once; what their captions show is told.
    """

    row_bytes = 48

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._captions: list[_Caption] = []

    def take_in(self, moment: HomeMoment) -> None:
        """Caption what is in view."""
        rows = tuple(self._row(seen, moment.deed) for seen in moment.seen[:_IN_CAPTION])
        if rows:
            there = frozenset(seen.place_id or "" for seen in moment.seen)
            self._captions.append(_Caption(moment.time_s, rows, there))

    def size_bytes(self) -> int:
        """Return bytes of captions, each with its time, place and vector."""
        return sum(
            self.row_bytes + self._vector_bytes + sum(row.size for row in one.rows)
            for one in self._captions
        )

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what the captions found by text, place and time show, merged in turn."""
        if not self._captions:
            return ()
        said, near = question.thing, self._texts.similarities(question)
        scores = np.array([near[[row.text for row in one.rows]].max() for one in self._captions])
        times = np.array([one.time_s for one in self._captions])
        found = [best_first(scores + 1e-9 * times, CAPTIONS)]
        if said.room or said.place_types:
            there = [
                any(is_said_place(self._places.get(place_id), said) for place_id in one.place_ids)
                for one in self._captions
            ]
            found.append(best_first(np.where(there, scores, -1.0), CAPTIONS))
        if said.after_s is not None and said.before_s is not None:
            then = (times >= said.after_s) & (times <= said.before_s)
            found.append(best_first(np.where(then, scores, -1.0), CAPTIONS))
        numbers = dict.fromkeys(int(at) for turn in zip(*found, strict=True) for at in turn)
        rows = [row for at in numbers for row in self._captions[at].rows]
        return self._nearest(rows, question, k)


DESIGNS: Mapping[str, Callable[[MemorySetting], HomeMemory]] = {
    "ours": TrueMemory,
    "ours-units": TrueUnits,
    "append-only": AppendOnly,
    "mem0": Mem0Style,
    "temporal-graph": TemporalGraph,
    "remembr": ReMEmbRStyle,
    "memgpt": MemGptStyle,
    "karma-fifo": partial(KarmaUnits, policy="fifo-merge[{0}]"),
    "karma-lru": partial(KarmaUnits, policy="lru[{0}]"),
    "karma-wtinylfu": partial(KarmaUnits, policy="wtinylfu-karma[{1},{2}]"),
    "last-seen": LastSeen,
    "none": NoMemory,
}
