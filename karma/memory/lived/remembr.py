"""ReMEmbR-style: captions with time and place, found by text, by place and by time.

Anwar et al. 2024, "ReMEmbR: Building and reasoning over long-horizon spatio-temporal memory for
robot navigation" (arXiv:2409.13682): short clips are captioned and stored with their time and the
robot's position; an agent calls three retrieval functions (text, position, time) until it can
answer. Here a caption is what one view shows, written without a model, and the question's own
fields choose the functions, each called once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace
from karma.memory.lived.setting import MemorySetting, sighting_text
from karma.memory.lived.texts import TextVectors, best_first

CAPTIONS = 6  # that each function returns
_IN_CAPTION = 8  # things that a caption names


@dataclass(frozen=True, slots=True)
class _Caption:
    moment: HomeMoment
    texts: tuple[int, ...]  # of its parts


class ReMEmbRStyle:
    """A `HomeMemory` of views, not of things.

    Args:
        setting: of the home.
    """

    name = "ReMEmbR-style"

    def __init__(self, setting: MemorySetting) -> None:
        self._places = setting.places
        self._texts = TextVectors(setting.embedder)
        self._captions: list[_Caption] = []
        self._bytes = 0
        self._row_bytes = 4 * setting.embedder.dimension

    def take_in(self, moment: HomeMoment) -> None:
        """Caption what is in view."""
        if not moment.seen:
            return
        texts = [sighting_text(seen, self._places) for seen in moment.seen[:_IN_CAPTION]]
        numbers = tuple(map(self._texts.number, texts))
        self._captions.append(_Caption(moment, numbers))
        self._bytes += sum(map(len, texts)) + 48 + self._row_bytes

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what the captions found by text, place and time show, merged in turn."""
        if not self._captions:
            return ()
        near = self._texts.similarities(question)
        scores = np.array([near[list(one.texts)].max() for one in self._captions])
        times = np.array([one.moment.time_s for one in self._captions])
        found = [best_first((scores + 1e-9 * times).tolist(), CAPTIONS)]
        said = question.thing
        if said.room or said.place_types:
            there = [self._is_at(one, question) for one in self._captions]
            found.append(best_first(np.where(there, scores, -1.0).tolist(), CAPTIONS))
        if said.after_s is not None and said.before_s is not None:
            then = (times >= said.after_s) & (times <= said.before_s)
            found.append(best_first(np.where(then, scores, -1.0).tolist(), CAPTIONS))
        numbers = list(dict.fromkeys(int(at) for turn in zip(*found, strict=True) for at in turn))
        facts = [
            (float(near[text]), Fact(sighting=seen, deed=self._captions[at].moment.deed))
            for at in numbers
            for text, seen in zip(
                self._captions[at].texts, self._captions[at].moment.seen, strict=False
            )
        ]
        facts.sort(key=lambda pair: -pair[0])
        return [fact for _, fact in facts[:k]]

    def _is_at(self, caption: _Caption, question: HomeQuestion) -> bool:
        said = question.thing
        for seen in caption.moment.seen:
            place = self._places.get(seen.place_id or "")
            if place is None:
                continue
            kind = not said.place_types or place.place_type in said.place_types
            if kind and (not said.room or said.room == place.room_kind):
                return True
        return False

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it has no opinion."""
        return ()

    def size_bytes(self) -> int:
        """Return bytes of captions, each with its time, place and vector."""
        return self._bytes

    def close(self) -> None:
        """Nothing is to be kept."""
