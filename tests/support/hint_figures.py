"""How often hints are right: for words that are held out, and for known ones as if never seen."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from karma.bench.figures.statistics import wilson
from karma.contracts import Embedder, Vectors
from karma.language.hints import SHARPNESS, WordFile, singular
from karma.language.lexemes import every_word, held_out, types_called
from karma.language.words import base_of
from karma.plugins.training.drawing.phrases import our_book

DEEDS: Mapping[str, str] = MappingProxyType(
    {
        "place": "put", "trash": "throw", "clean": "wash", "heat": "heat", "cook": "cook",
        "cool": "cool", "slice": "slice", "toast": "toast", "fill": "fill", "coffee": "fill",
        "switch_on": "on", "switch_off": "off", "open": "open", "close": "close",
        "hold": "take", "look": "look", "break": "break",
    }
)  # kind of request -> deed of the hints  # fmt: skip
FITS = 3  # types that a vaguer word may fit to be asked for
Way = Callable[[NDArray[np.float32]], float]  # scores of a type's texts -> its score


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedWord:
    """One word, and the types or deeds that a hint is right to name."""

    group: str  # names, kinds, uses, verbs
    phrase: str
    right: frozenset[str]
    left_out: frozenset[str] = frozenset()  # words whose texts are left out


WAYS: Mapping[str, Way] = MappingProxyType(
    {
        "all texts, the nearest most": lambda s: float(np.log(np.exp(SHARPNESS * s).sum())),
        "the nearest text": lambda s: float(s.max()),
        "the mean of all texts": lambda s: float(s.mean()),
        "the first text alone": lambda s: float(s[0]),
    }
)  # the first one is that of `karma.language.hints`


def asked_words(*, unseen: bool) -> Iterator[AskedWord]:
    """Yield the lexemes that are held out, or those that training has, each as if never seen."""
    out, right = held_out(), dict[tuple[str, str], set[str]]()
    for kind, entry in every_word().items():
        for group, texts in (("names", entry.names), ("kinds", entry.kinds), ("uses", entry.uses)):
            for text in texts:
                if len(types_called(text)) <= FITS or group == "names":
                    right.setdefault((group, text), set()).add(kind)
    for kind, verbs in our_book().verbs.items():
        for verb in verbs:
            right.setdefault(("verbs", verb), set()).add(DEEDS[kind])
    for (group, text), names in sorted(right.items()):
        if (text in out.texts) == unseen:
            head = text.partition(" of ")[0].split()[-1]
            words = () if unseen else (head, singular(head), base_of(text.split()[0]) or head)
            phrase = f"something to {text}" if group == "uses" else text
            yield AskedWord(
                group=group, phrase=phrase, right=frozenset(names), left_out=frozenset(words)
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class HintFigures:
    """How often the right meaning is first, and among the first three."""

    group: str
    way: str
    number: int
    first: int
    third: int

    def __str__(self) -> str:
        """Return one line, with 95 % intervals."""
        return f"{self.group:6} {self.way:28} {self.number:5}  {_rate(self.first, self.number)}" + (
            f"  {_rate(self.third, self.number)}"
        )


def _rate(hits: int, number: int) -> str:
    found = wilson(hits, number)
    return f"{hits / number:.2f} [{found.low:.2f}, {found.high:.2f}]" if found else "–"


def figures(
    file: WordFile, embedder: Embedder, asked: Sequence[AskedWord]
) -> Iterator[HintFigures]:
    """Yield the figures of each group of words and each way to score a type by its texts."""
    tables = {
        False: _TextTable(file.types, embedder),
        True: _TextTable(file.deeds, embedder),
    }
    hits: dict[tuple[str, str], list[tuple[bool, bool]]] = {}
    for word in asked:
        table, vector = tables[word.group == "verbs"], embedder.embed([word.phrase])[0]
        scores = table.scores(vector, word.left_out)
        for name, way in WAYS.items():
            best = sorted(scores, key=lambda one: -way(scores[one]) if len(scores[one]) else np.inf)
            found = best[0] in word.right, not word.right.isdisjoint(best[:3])
            hits.setdefault((word.group, name), []).append(found)
    for (group, name), found_all in hits.items():
        first, third = (sum(column) for column in zip(*found_all, strict=True))
        yield HintFigures(group=group, way=name, number=len(found_all), first=first, third=third)


class _TextTable:
    """The texts of all types, or of all deeds."""

    def __init__(self, part: Mapping[str, Sequence[str]], embedder: Embedder) -> None:
        texts = [text for _, some in sorted(part.items()) for text in some]
        self._vectors = embedder.embed(texts)
        self._ends = dict(
            zip(sorted(part), np.cumsum([len(part[n]) for n in sorted(part)]), strict=True)
        )
        self._rows: dict[str, list[int]] = {}
        for row, text in enumerate(texts):
            for word in {form for said in text.split() for form in _forms(said)}:
                self._rows.setdefault(word, []).append(row)

    def scores(self, vector: Vectors, left_out: frozenset[str]) -> Mapping[str, Vectors]:
        """Return name -> how near its texts are, without those with a word that is left out."""
        near = self._vectors @ vector
        near[[row for word in left_out for row in self._rows.get(word, ())]] = np.nan
        begin, found = 0, {}
        for name, end in self._ends.items():
            part = near[begin:end]
            found[name], begin = part[~np.isnan(part)], end
        return found


def _forms(word: str) -> tuple[str, ...]:
    return word, singular(word), base_of(word) or word
