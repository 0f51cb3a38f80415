"""spaCy's small English model as an ordinary package brings it, verified by hash, loaded lazily."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from importlib.util import find_spec
from typing import Any

from karma.errors import KarmaError
from karma.models.manifest import resolve_folder
from karma.plugins.rules.types import Word
from karma.registry import fix_of

NAME = "en-core-web-sm"
_UNUSED = ("ner", "senter")
_ENDINGS = ("s", "es", "ed", "d", "ing", "er", "ly", "'s")


class SpacyParser:
    """A parser of English, named as in the manifest; one thread.

    Raises:
        KarmaError: spaCy is not installed.
        ModelError: a file is missing or is not the one that the manifest names.
    """

    def __init__(self, name: str = NAME) -> None:
        if find_spec("spacy") is None:
            raise KarmaError(f"requests are parsed by spaCy, which is missing\n  {fix_of('rules')}")
        self.name = name
        self._folder = resolve_folder(name, "parser").path

    @cached_property
    def _pipeline(self) -> Any:
        with _without_torch():
            import spacy
        return spacy.load(self._folder, exclude=list(_UNUSED))

    def parse(self, text: str) -> Sequence[Word]:
        """Return the words of a text, without blanks."""
        found = [word for word in self._pipeline(text) if not word.is_space]
        number = {word.i: place for place, word in enumerate(found)}
        return [
            Word(
                text=word.text, start=word.idx, lemma=word.lemma_.lower(), tag=word.tag_,
                dep=word.dep_, head=number.get(word.head.i, place),
            )
            for place, word in enumerate(found)
        ]  # fmt: skip

    def knows(self, word: str) -> bool:
        """Return whether a word, in small letters, is English, by WordNet's index and endings."""
        stems = {word, *(word.removesuffix(end) for end in _ENDINGS)}
        stems |= {f"{stem}e" for stem in stems} | {stem[:-1] for stem in stems if len(stem) > 3}
        return not self._index.isdisjoint(stems) or word in self._forms

    @cached_property
    def _index(self) -> frozenset[str]:
        """Base forms."""
        table = self._pipeline.get_pipe("lemmatizer").lookups.get_table("lemma_index")
        return frozenset(word for words in table.values() for word in words)

    @cached_property
    def _forms(self) -> frozenset[str]:
        """Forms that follow no rule."""
        table = self._pipeline.get_pipe("lemmatizer").lookups.get_table("lemma_exc")
        return frozenset(word for words in table.values() for word in words)


@contextmanager
def _without_torch() -> Iterator[None]:
    """Let spaCy's import pass torch by, which takes 1.5 s and which this model does not use."""
    if "torch" in sys.modules:
        yield
        return
    sys.modules["torch"] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules["torch"]
