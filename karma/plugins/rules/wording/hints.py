"""What words that a planner has not learnt may mean: the nearest types and deeds, with cosines.

Every type and deed has several short texts (`meanings.toml`, and what the caller adds: names). They
are embedded once, one at a time, and kept beside the planner's weights. Types are ordered by the
log-sum of how near their texts are to a phrase; the similarity told is that of the nearest text.
Phrases that the planner knows get no hint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from karma.files import read_json, read_toml, to_json, write_atomic
from karma.plugins.rules.wording.parts import NounPhrase, VerbPhrase
from karma.plugins.rules.wording.phrases import phrases_of
from karma.plugins.rules.wording.words import base_of, word_lists
from karma.types.planning import Hint, Meaning
from karma.types.roles import Embedder
from karma.types.space import Vectors

HERE = Path(__file__).parent
TYPE_WORDS = HERE / "type_words.json"  # what types are called, with MiniLM's vectors beside it
TYPES_SAID, DEEDS_SAID = 3, 2  # meanings per hint
MOST = 4  # hints per instruction
LONGEST = 8  # words of a phrase
SHARPNESS = 20.0  # of the sum over a type's texts: the best one counts most, the others a little


class _OwnTexts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    types: dict[str, tuple[str, ...]]
    deeds: dict[str, tuple[str, ...]]


@cache
def own_texts() -> _OwnTexts:
    """Return our texts per object type and per deed."""
    return read_toml(HERE / "meanings.toml", _OwnTexts)


class WordFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a planner's words file holds: texts of types and deeds, and what training taught."""

    types: dict[str, tuple[str, ...]]
    deeds: dict[str, tuple[str, ...]]
    phrases: frozenset[str]  # known as they stand: names, kinds, verbs with their particles
    words: frozenset[str]  # content words that training saw often; before a phrase they are known

    def knows(self, phrase: str) -> bool:
        """Return whether the planner has learnt a phrase: as it stands, or behind known words.

        "Green mug" is known where "mug" and the word "green" are.
        """
        words = phrase.split()
        for first in range(len(words)):
            rest = " ".join(words[first:])
            if rest in self.phrases or singular(rest) in self.phrases:
                return True
            if is_content(words[first]) and words[first] not in self.words:
                return False
        return False


def is_content(word: str) -> bool:
    """Return whether a word is in no list of function words."""
    return word not in _function_words()


@cache
def _function_words() -> frozenset[str]:
    lists = word_lists()
    return lists.prepositions | lists.determiners | lists.persons | lists.auxiliaries | (
        lists.conjunctions | lists.adverbs | lists.particles | lists.pronouns | lists.heads
    )  # fmt: skip


def singular(phrase: str) -> str:
    """Return a phrase with its last word in the singular, as far as rules go.

    >>> singular("wine glasses"), singular("butter knives"), singular("berries"), singular("glass")
    ('wine glass', 'butter knife', 'berry', 'glass')
    """
    endings = (
        ("knives", "knife"), ("loaves", "loaf"), ("shelves", "shelf"), ("ies", "y"), ("sses", "ss"),
        ("xes", "x"), ("ches", "ch"), ("shes", "sh"), ("oes", "o"), ("ss", "ss"), ("us", "us"),
        ("s", ""),
    )  # fmt: skip
    for plural, single in endings:
        if phrase.endswith(plural) and (len(plural) > 4 or len(phrase) > len(plural) + 1):
            return phrase.removesuffix(plural) + single
    return phrase


@dataclass(frozen=True, kw_only=True)
class Query:
    """A phrase of an instruction that a hint can be given for."""

    phrase: str  # as the hint shows it
    is_deed: bool
    start: int  # of the phrase, in characters of the instruction; -1 where it is not one run of it
    head: str  # the word that says what it is


def queries(instruction: str) -> tuple[Query, ...]:
    """Return the noun phrases of an instruction without their states, then its verbs."""
    found = phrases_of(instruction)
    nouns = [_noun_query(noun, instruction) for noun in found.nouns]
    verbs = [_verb_query(verb) for verb in found.verbs]
    distinct = {query.phrase: query for query in reversed([*nouns, *verbs]) if query is not None}
    return tuple(reversed(distinct.values()))


def _noun_query(noun: NounPhrase, instruction: str) -> Query | None:
    words = bare_words(noun.text.split())[:LONGEST]
    if not any(map(is_content, words)):
        return None
    phrase = " ".join(words)
    start = instruction.lower().find(phrase, noun.start, noun.end)
    return Query(phrase=phrase, is_deed=False, start=start, head=noun.head)


def _verb_query(verb: VerbPhrase) -> Query | None:
    if verb.base in word_lists().auxiliaries or len(verb.base) < 3:
        return None
    return Query(phrase=verb.text, is_deed=True, start=verb.start, head=verb.base)


def bare_words(words: Sequence[str]) -> Sequence[str]:
    """Return a noun phrase without the words of state and size before it.

    >>> bare_words(["clean", "little", "tumbler"]), bare_words(["clean"])
    (['tumbler'], ['clean'])
    """
    first = 0
    while words[first] in word_lists().qualifiers and words[first + 1 :][:1] not in ([], ["of"]):
        first += 1
    return words[first:]


class Words:
    """The texts of types and deeds with their vectors, and which phrases are known.

    Args:
        file: texts and known words.
        vectors: shape (n, d), a row of length 1 per text, types first, each in order of its name.
    """

    def __init__(self, file: WordFile, vectors: Vectors) -> None:
        self.file, self.vectors = file, vectors
        self.texts = texts_in_order(file)
        types = sum(map(len, file.types.values()))
        self._rows = {False: _rows_of(file.types), True: _rows_of(file.deeds, types)}

    @cached_property
    def _containing(self) -> Mapping[str, NDArray[np.intp]]:
        """Word, or base of a verb -> numbers of the texts that it stands in."""
        rows: dict[str, list[int]] = {}
        for number, text in enumerate(self.texts):
            words = {one for word in text.lower().split() for one in (word, singular(word))}
            for word in words | {base for word in words if (base := base_of(word))}:
                rows.setdefault(word, []).append(number)
        return {word: np.array(numbers) for word, numbers in rows.items()}

    def nearest(
        self, vector: Vectors, *, is_deed: bool, without: Sequence[str] = ()
    ) -> tuple[Meaning, ...]:
        """Return the nearest types or deeds of a phrase, the likeliest first.

        Args:
            vector: of the phrase, shape (d,), length 1.
            is_deed: whether deeds are asked for.
            without: words whose texts are left out, as if nobody had ever written them.
        """
        scores = self.vectors @ vector
        for word in without:
            if word in self._containing:
                scores[self._containing[word]] = -1.0
        names, rows = list(self._rows[is_deed]), list(self._rows[is_deed].values())
        first, starts = rows[0].start, [one.start - rows[0].start for one in rows]
        part = scores[first : rows[-1].stop]
        best = np.maximum.reduceat(part, starts)
        near = np.log(np.add.reduceat(np.exp(SHARPNESS * part), starts))
        order = np.argsort(-near, kind="stable")[: DEEDS_SAID if is_deed else TYPES_SAID]
        return tuple(Meaning(name=names[n], similarity=float(best[n])) for n in order)

    def rows_of(self, object_type: str) -> Vectors:
        """Return the vectors of a type's texts, shape (n, d); n is 0 for a type without texts."""
        return self.vectors[self._rows[False].get(object_type, slice(0, 0))]


def _rows_of(part: Mapping[str, Sequence[str]], first: int = 0) -> Mapping[str, slice]:
    """Return which rows of the vectors belong to a type or deed, by name, of those with texts."""
    found = {}
    for name, texts in sorted(part.items()):
        if texts:
            found[name] = slice(first, first + len(texts))
            first += len(texts)
    return found


def texts_in_order(file: WordFile) -> list[str]:
    """Return all texts as their vectors stand: types by name, then deeds by name."""
    return [
        text for part in (file.types, file.deeds) for _, texts in sorted(part.items())
        for text in texts
    ]  # fmt: skip


class Hinter:
    """Reads the phrases of an instruction, for a planner that was trained with a words file."""

    def __init__(self, words: Words, embedder: Embedder) -> None:
        self.words, self._embedder = words, embedder

    def hints(self, instruction: str) -> tuple[Hint, ...]:
        """Return what unknown phrases may mean, in the order of the text, nouns first."""
        unknown = [q for q in queries(instruction) if not self.words.file.knows(q.phrase)]
        return tuple(
            Hint(phrase=query.phrase, meanings=self.words.nearest(vector, is_deed=query.is_deed))
            for query in unknown[:MOST]
            for vector in self._embedder.embed([query.phrase])
        )

    def objects(self, instruction: str) -> dict[str, frozenset[str]]:
        """Return the objects that an instruction mentions, and the types called so."""
        nouns = (noun.text.lower().split() for noun in phrases_of(instruction).nouns)
        names = (" ".join(bare_words(words)) for words in nouns)
        called = types_by_text()
        return {
            singular(name): called.get(name, frozenset()) | called.get(singular(name), frozenset())
            for name in names
        }


@cache
def types_by_text() -> Mapping[str, frozenset[str]]:
    """Return text -> object types that are called so."""
    found: dict[str, set[str]] = {}
    for kind, texts in read_json(TYPE_WORDS, WordFile).types.items():
        for text in texts:
            found.setdefault(text, set()).add(kind)
    return {text: frozenset(kinds) for text, kinds in found.items()}


def open_reader(path: Path, embedder: Embedder) -> Hinter:
    """Return the reader of a planner with a words file."""
    return Hinter(load_words(path, embedder), embedder)


# ----------------------------------------------------------------- the files


def embed_texts(embedder: Embedder, texts: Sequence[str]) -> Vectors:
    """Return a row per text, embedded one at a time and kept in half precision."""
    rows = [embedder.embed([text])[0] for text in texts]
    found = np.array(rows, dtype=np.float16).astype(np.float32)
    return found.reshape(len(texts), embedder.dimension)


def write_words(path: Path, file: WordFile, embedder: Embedder) -> Words:
    """Write a words file, and the vectors of its texts beside it; return both."""
    write_atomic(path, to_json(file, indent=1))
    return Words(file, _made_vectors(path, file, embedder))


def load_words(path: Path, embedder: Embedder) -> Words:
    """Read a words file and its vectors; what does not fit its texts and embedder is made anew.

    Raises:
        FileError: the words file is missing or torn.
    """
    file = read_json(path, WordFile)
    kept = _vectors_beside(path)
    found = _kept_vectors(kept, _stamp(file, embedder.name))
    return Words(file, _made_vectors(None, file, embedder) if found is None else found)


def kept_words(path: Path, embedder: Embedder) -> Words | None:
    """Read a words file with its vectors; None without it, or if another embedder made these.

    Raises:
        FileError: the words file is torn.
    """
    if not path.exists():
        return None
    file = read_json(path, WordFile)
    vectors = _kept_vectors(_vectors_beside(path), _stamp(file, embedder.name))
    return None if vectors is None else Words(file, vectors)


def _vectors_beside(path: Path) -> Path:
    return path.with_suffix(".safetensors")


def _stamp(file: WordFile, embedder: str) -> dict[str, str]:
    """Return what vectors must have been made from."""
    return {"embedder": embedder, "texts": sha256(to_json(texts_in_order(file))).hexdigest()}


def _kept_vectors(path: Path, stamp: Mapping[str, str]) -> Vectors | None:
    """Return vectors from a file; None where it is missing, torn, or made from something else."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), framework="numpy") as kept:
            if dict(kept.metadata() or {}) != stamp:
                return None
            vectors: Vectors = kept.get_tensor("texts").astype(np.float32)
    except (OSError, SafetensorError, KeyError):
        return None
    return vectors


def _made_vectors(path: Path | None, file: WordFile, embedder: Embedder) -> Vectors:
    """Embed all texts, and write them beside a words file if its path is given."""
    from safetensors.numpy import save

    vectors = embed_texts(embedder, texts_in_order(file))
    if path is not None:
        half = {"texts": vectors.astype(np.float16)}
        write_atomic(_vectors_beside(path), save(half, metadata=_stamp(file, embedder.name)))
    return vectors
