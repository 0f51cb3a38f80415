"""How near words of a request come to types of things and to deeds, whatever planner is asked."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from functools import cached_property

from karma.files import read_json
from karma.household.saying import spoken
from karma.household.types import types_with
from karma.plugins.rules.language.request_words import deed_states, request_words
from karma.plugins.rules.language.slips import is_a_slip
from karma.plugins.rules.wording.hints import TYPE_WORDS, WordFile, kept_words, singular
from karma.types.roles import Embedder
from karma.types.space import Vectors

LEAST_LETTERS, SLIP = 5, 0.87  # of a word that may be misspelt, and how alike it has to be
_MANY = ("can",)  # that may be anything: a tin, a bin, a toilet
DESCRIBED = 3  # types that a description may mean
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
        self._found: dict[str, tuple[str, ...]] = {}  # phrase -> its types

    @cached_property
    def _file(self) -> WordFile:
        return self._words.file if self._words else read_json(TYPE_WORDS, WordFile)

    def named(self, phrase: str) -> tuple[str, ...]:
        """Return the types that are called so, by one of our texts or by a slip of one; () if none.

        >>> Lexicon(None).named("spud"), Lexicon(None).named("spray botle")
        (('Potato',), ('SprayBottle',))
        """
        phrase = " ".join(phrase.lower().replace("-", " ").split())
        if phrase not in self._found:
            self._found[phrase] = self._types_called(phrase)
        return self._found[phrase]

    def _types_called(self, phrase: str) -> tuple[str, ...]:
        for said in dict.fromkeys((phrase, singular(phrase))):
            if said in self._by_text:
                return self._by_text[said]
        if len(phrase) < LEAST_LETTERS:
            return ()
        alike = self._by_letter.get(phrase[0], [])
        if not get_close_matches(phrase, alike, n=1, cutoff=SLIP):
            return ()
        near = get_close_matches(phrase, self._texts, n=1, cutoff=SLIP)
        if near[0][0] != phrase[0]:
            return ()
        other = set(phrase.split()) - set(near[0].split())  # "cold plate" is no slip
        return () if other <= self._words_said else self._by_text[near[0]]

    @cached_property
    def _by_text(self) -> Mapping[str, tuple[str, ...]]:
        """Text -> the types that it stands with."""
        found: dict[str, list[str]] = {}
        for kind, texts in self._file.types.items():
            for text in dict.fromkeys((spoken(kind).lower(), kind.lower(), *texts)):
                found.setdefault(text.replace("-", " "), []).append(kind)
        for text in _MANY:
            found.pop(text, None)
        for kind in self._file.types:  # a coffee machine is a machine: no table, which others are
            head = spoken(kind).lower().split()[-1]
            if head in found and not set(found[head]) & {*self._by_head[head]}:
                found[head].append(kind)
        carried = types_with("receptacle") & types_with("pickupable")
        holds = [kind for kind in self._file.types if kind in carried]
        found |= dict.fromkeys(request_words().containers, holds)
        own = {spoken(kind).lower(): (kind,) for kind in self._file.types}
        return {text: tuple(dict.fromkeys(kinds)) for text, kinds in found.items()} | own

    def named_whole(self, phrase: str) -> bool:
        """Return whether several words together are what a thing is called: "frying pan"."""
        return phrase in self._by_text

    def besides(self, phrase: str) -> tuple[str, ...]:
        """Return the types that people call so as well: a mug is a cup, a side table a table.

        >>> Lexicon(None).besides("cup"), "SideTable" in Lexicon(None).besides("table")
        (('Mug',), True)
        """
        said = dict.fromkeys((phrase, singular(phrase)))
        also = [kind for word in said for kind in request_words().called.get(word, ())]
        heads = (kind for word in said for kind in self._by_head.get(word, ()))
        named = self.named(phrase)
        return tuple(one for one in dict.fromkeys((*also, *heads)) if one not in named)

    @cached_property
    def _by_head(self) -> Mapping[str, list[str]]:
        """Last word of a type's name -> types: a side table is a table."""
        found: dict[str, list[str]] = {}
        for kind in self._file.types:
            found.setdefault(spoken(kind).lower().split()[-1], []).append(kind)
        return found

    def misspelt(self, word: str, kinds: Sequence[str]) -> str:
        """Return what a word may be a slip of, where that is one of some types; "" for nothing.

        >>> Lexicon(None).misspelt("bok", ["Book"]), Lexicon(None).misspelt("cat", ["Mug"])
        ('book', '')
        """
        here = set(kinds)
        found = (one for one in self._by_text if " " not in one and is_a_slip(word.lower(), one))
        return next((one for one in sorted(found) if here & {*self._by_text[one]}), "")

    def described(self, phrase: str) -> tuple[str, ...]:
        """Return the types that a description comes nearest to: "something to write with".

        None without an embedder, unless it is one of our texts.
        """
        named = self.named(phrase)
        if named or self._words is None:
            return named
        return self.nearest(phrase, list(self._file.types), DESCRIBED)

    @cached_property
    def words(self) -> list[str]:
        """All words of short texts: what people call things."""
        short = (text.split() for text in self._by_text if len(text.split()) < 4)
        return sorted({word for words in short for word in words if len(word) > 2})

    @cached_property
    def _words_said(self) -> frozenset[str]:
        """Words that are spelt right: of our texts, and of how things are."""
        return frozenset(self.words) | deed_states().keys()

    @cached_property
    def _by_letter(self) -> Mapping[str, list[str]]:
        """The same by their first letters: a slip keeps it."""
        found: dict[str, list[str]] = {}
        for text in self._texts:
            found.setdefault(text[0], []).append(text)
        return found

    @cached_property
    def _texts(self) -> list[str]:
        return [text for text in self._by_text if len(text) >= LEAST_LETTERS]

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
