"""How near words of a request come to types of things and to deeds, whatever planner is asked."""

from collections.abc import Mapping, Sequence
from functools import cached_property

from karma.contracts import Embedder, Vectors
from karma.files import read_json
from karma.language.hints import TYPE_WORDS, WordFile, kept_words, singular

ALIKE = 0.5  # cosine from which on a phrase may speak of a type


class Lexicon:
    """Our texts of types and deeds, with an embedder for phrases that are none of them.

    Args:
        embedder: without the one that made our vectors, only texts as they stand are known.
    """

    def __init__(self, embedder: Embedder | None) -> None:
        self._embedder = embedder
        self._words = kept_words(TYPE_WORDS, embedder) if embedder is not None else None
        self._vectors: dict[str, Vectors] = {}

    @cached_property
    def _file(self) -> WordFile:
        return self._words.file if self._words else read_json(TYPE_WORDS, WordFile)

    def likeness(self, phrase: str, kinds: Sequence[str]) -> Mapping[str, float]:
        """Return how near a phrase is to each of some types: a cosine, 1 for one of its texts."""
        phrase = phrase.lower()
        said = {phrase, singular(phrase)}
        found = {}
        for kind in kinds:
            if said & {*self._file.types.get(kind, ()), kind.lower()}:
                found[kind] = 1.0
            elif self._words is not None and len(rows := self._words.rows_of(kind)):
                found[kind] = float((rows @ self._vector(phrase)).max())
            else:
                found[kind] = 0.0
        return found

    def nearest(self, phrase: str, kinds: Sequence[str], most: int = 3) -> tuple[str, ...]:
        """Return the types that a phrase comes nearest to, of those that it is alike to at all."""
        near = self.likeness(phrase, kinds)
        ranked = sorted(kinds, key=lambda kind: -near[kind])
        return tuple(kind for kind in ranked if near[kind] >= ALIKE)[:most]

    def deeds(self, phrase: str) -> tuple[str, ...]:
        """Return the deeds that a verb comes nearest to, the likeliest first; () if unknown."""
        if self._words is None:
            return ()
        near = self._words.nearest(self._vector(phrase), is_deed=True)
        return tuple(meaning.name for meaning in near)

    def _vector(self, phrase: str) -> Vectors:
        if phrase not in self._vectors and self._embedder is not None:
            self._vectors[phrase] = self._embedder.embed([phrase])[0]
        return self._vectors[phrase]
