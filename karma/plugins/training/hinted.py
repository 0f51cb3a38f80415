"""Hints in training examples: likely meanings of unknown words.

A share of known phrases is treated as unknown, with hints that leave out every text with the
phrase's word, so that they are no better than hints of a new word. In a smaller share a
noun becomes an invented word with the noun's hints: only a model that reads hints can answer.
Vectors come from a cache.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save

from karma.agent.planning.prompt import compact_words
from karma.files import write_atomic
from karma.plugins.rules.language.lexemes import Entry, lexicon, types_called, unseen_lexemes
from karma.plugins.rules.wording.hints import (
    MOST,
    Query,
    WordFile,
    Words,
    embed_texts,
    is_content,
    own_texts,
    queries,
)
from karma.plugins.training.drawing.memories import Rng, pick
from karma.plugins.training.samples import TrainingExample
from karma.types.planning import Hint
from karma.types.roles import Embedder
from karma.types.space import Vectors

UNKNOWN = 0.20  # share of examples in which known phrases are treated as unknown
EACH = {False: 0.6, True: 0.25}  # share of their noun phrases then, and of their verbs
INVENTED = 0.05  # share of examples with an invented noun
OFTEN = 3  # times that a word must occur in the sampled sentences to be known
FITS = 6  # types that a text may fit at most
_ONSETS = ("b", "bl", "d", "dr", "f", "fl", "g", "gr", "k", "m", "n", "p", "pl", "s", "t", "v", "z")
_VOWELS = ("a", "e", "i", "o", "u", "oo", "ee")
_ENDS = ("b", "ck", "d", "ft", "g", "l", "m", "n", "p", "rt", "sk", "t", "x", "zz")


@dataclass(frozen=True, kw_only=True)
class DrawnHints:
    """Adds hints to training examples."""

    words: Words  # texts, their vectors and known words
    vectors: Mapping[str, Vectors]  # phrase -> row; a phrase without one gets no hint
    names: frozenset[str]  # what single types are called; these become invented words
    _given: dict[tuple[str, bool, tuple[str, ...]], Hint] = field(default_factory=dict)  # again

    def told(self, rng: Rng, example: TrainingExample) -> TrainingExample:
        """Return an example with hints, and perhaps with an invented noun."""
        task, rest = example.changing.split("\n", 1)
        sentence, hints = self.hinted(rng, example.sentence)
        task = task.removesuffix(example.sentence) + sentence
        return replace(example, changing=f"{task}\n{compact_words(hints)}{rest}")

    def hinted(self, rng: Rng, sentence: str) -> tuple[str, Sequence[Hint]]:
        """Return a sentence, perhaps with an invented noun, and its hints."""
        roll = rng.random()
        asked = queries(sentence)
        hints: list[Hint] = []
        for query in asked:
            forgotten = INVENTED < roll < INVENTED + UNKNOWN and rng.random() < EACH[query.is_deed]
            if forgotten or not self.words.file.knows(query.phrase):
                hints += self._hint(query, without=(query.head,) if forgotten else ())
        if roll < INVENTED:
            sentence, hints = self._invented(rng, sentence, asked, hints)
        return sentence, hints[:MOST]

    def _hint(self, query: Query, *, without: Sequence[str]) -> list[Hint]:
        vector = self.vectors.get(query.phrase)
        key = (query.phrase, query.is_deed, tuple(without))
        if vector is None:
            return []
        if key not in self._given:
            meanings = self.words.nearest(vector, is_deed=query.is_deed, without=without)
            self._given[key] = Hint(phrase=query.phrase, meanings=meanings)
        return [self._given[key]]

    def _invented(
        self, rng: Rng, sentence: str, asked: Sequence[Query], hints: list[Hint]
    ) -> tuple[str, list[Hint]]:
        """Replace a noun by an invented word."""
        nouns = [q for q in asked if not q.is_deed and q.start >= 0 and q.phrase in self.names]
        query = pick(rng, nouns) if nouns else None
        if query is None or query.phrase not in self.vectors:
            return sentence, hints
        (hint,) = self._hint(query, without=(query.head,))
        (full,) = self._hint(query, without=())
        if full.meanings[0].name not in {meaning.name for meaning in hint.meanings}:
            hint = full  # without it the meaning cannot be found
        word, end = invented_word(rng), query.start + len(query.phrase)
        others = [other for other in hints if other.phrase != query.phrase]
        changed = sentence[: query.start] + word + sentence[end:]
        return changed, [replace(hint, phrase=word), *others]


def invented_word(rng: Rng) -> str:
    """Return an invented word of two syllables."""
    return "".join(pick(rng, part) for part in (_ONSETS, _VOWELS, _ENDS, _VOWELS, _ENDS))


def called() -> tuple[str, ...]:
    """Return all names of types on the training side, vague words and uses included."""
    return tuple(dict.fromkeys(text for entry in lexicon().values() for text in _texts(entry)))


def _texts(entry: Entry) -> Iterator[str]:
    yield from entry.names
    yield from entry.kinds
    yield from (f"something to {use}" for use in entry.uses)


def words_file(seen: Iterable[str]) -> WordFile:
    """Return texts of types and actions, and the words known from sentences.

    Words that fit many types are left out: they are near to all of them.
    """
    ours, unseen = own_texts(), unseen_lexemes()
    types, deeds = (
        {name: tuple(text for text in texts if not unseen.found_in(text)) for name, texts in part}
        for part in (ours.types.items(), ours.deeds.items())
    )
    for kind, entry in lexicon().items():
        own = (text for text in _texts(entry) if len(types_called(text)) <= FITS)
        types[kind] = tuple(dict.fromkeys((*own, *types.get(kind, ()))))
    said, words = known_words(seen, OFTEN)
    return WordFile(types=types, deeds=deeds, phrases=said | frozenset(called()), words=words)


def known_words(sentences: Iterable[str], at_least: int) -> tuple[frozenset[str], frozenset[str]]:
    """Return the phrases of sentences, and their content words, that occur so often."""
    phrases: Counter[str] = Counter()
    words: Counter[str] = Counter()
    for sentence in sentences:
        phrases.update(query.phrase for query in queries(sentence))
        words.update(filter(is_content, re.findall(r"[a-z]+", sentence.lower())))
    said = frozenset(phrase for phrase, times in phrases.items() if times >= at_least)
    return said, frozenset(word for word, times in words.items() if times >= at_least)


def phrases_to_embed(sentences: Iterable[str]) -> list[str]:
    """Return the phrases of sentences that hints may be asked for, the most frequent first."""
    counts = Counter(query.phrase for sentence in sentences for query in queries(sentence))
    return sorted(counts, key=lambda phrase: (-counts[phrase], phrase))


class KeptRows:
    """An `Embedder` that keeps its rows in a file, in half precision.

    Rows of another embedder are not used.
    """

    def __init__(self, embedder: Embedder, path: Path) -> None:
        self.name, self.dimension = embedder.name, embedder.dimension
        self._embedder, self._path = embedder, path
        self.rows: dict[str, Vectors] = {}
        if path.exists():
            with safe_open(str(path), framework="numpy") as kept:
                said = kept.metadata() or {}
                if said.get("embedder") == self.name:
                    rows = kept.get_tensor("rows").astype(np.float32)
                    self.rows = dict(zip(said["texts"].split("\n"), rows, strict=True))

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return a row per text, shape (n, dimension)."""
        for text in texts:
            if text not in self.rows:
                self.rows[text] = embed_texts(self._embedder, [text])[0]
        return np.array([self.rows[text] for text in texts]).reshape(len(texts), self.dimension)

    def save(self) -> None:
        """Write all rows."""
        rows = np.array(list(self.rows.values()), dtype=np.float16)
        metadata = {"embedder": self.name, "texts": "\n".join(self.rows)}
        write_atomic(self._path, save({"rows": rows}, metadata=metadata))
