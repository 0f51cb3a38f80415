"""The phrase book: names of objects and templates of requests, read from the files beside it."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from karma.files import read_toml
from karma.plugins.rules.language.lexemes import (
    Entry,
    held_out,
    lexicon,
    unseen_lexemes,
    unseen_lexicon,
)

HERE = Path(__file__).parent
UNSEEN_VAGUE = 0.35  # `vague` where the words are held out: names and uses are both to be asked
SPOKEN = 0.5  # share of patterns among ours
_CHOICE = re.compile(r"\(([^()]*)\)")
_DEED = re.compile(r"<(\w+)>")


_TEXTS = ("templates", "spoken", "adjectives", "just", "around", "references")

Texts = Mapping[str, tuple[str, ...]]
Verbs = Mapping[str, Mapping[str, tuple[str, ...]]]  # kind of deed -> word -> its phrases


@dataclass(frozen=True, slots=True, kw_only=True)
class Book:
    """Templates per kind of request, and words for states and past actions.

    `spoken` are patterns with their alternatives still in them, and `<clean>` for a phrase of
    `verbs`. Either side of the split has all that a pattern stands for, or nothing of it.
    """

    templates: Mapping[str, tuple[str, ...]]
    adjectives: Mapping[str, tuple[str, ...]]
    just: Mapping[str, tuple[str, ...]]
    around: Mapping[str, tuple[str, ...]]
    references: Mapping[str, tuple[str, ...]]
    spoken: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    verbs: Verbs = field(default_factory=dict)
    things: Mapping[str, Entry] = field(default_factory=lexicon)  # what they are called
    vague: float = 0.12  # share of things not remembered and of places that go by no name

    def part(self, *, held_out: bool) -> "Book":
        """Return a side of the fixed split of templates; about 8 % are held out.

        Neither side has lexemes that are held out (see `with_unseen_words`).
        """
        known = self._with_known_words()

        def side(book: Texts) -> dict[str, tuple[str, ...]]:
            return {
                kind: tuple(t for t in texts if self.is_held_out(t) == held_out)
                for kind, texts in book.items()
            }

        templates = {
            kind: texts or known.templates[kind] for kind, texts in side(known.templates).items()
        }
        return replace(known, spoken=side(known.spoken), templates=templates)

    def with_unseen_words(self) -> "Book":
        """Return the held-out templates with held-out words for objects, states and actions."""
        part, words = self.part(held_out=True), held_out()
        deeds = self.with_verbs(words.verbs, held_out=True)
        only = {kind: tuple(filter(_DEED.search, texts)) for kind, texts in deeds.templates.items()}

        def unseen(book: Texts, known: Texts) -> Texts:
            kept = {
                state: tuple(text for text in texts if text in words.adjectives)
                for state, texts in book.items()
            }
            return {state: texts or known[state] for state, texts in kept.items()}

        return replace(
            part,
            spoken=only,
            verbs=deeds.verbs,
            adjectives=unseen(self.adjectives, part.adjectives),
            just=unseen(self.just, part.just),
            things=unseen_lexicon(),
            vague=UNSEEN_VAGUE,
        )

    def _with_known_words(self) -> "Book":
        """Return the book without texts that contain a held-out lexeme."""

        def known(book: Texts) -> dict[str, tuple[str, ...]]:
            return {
                kind: tuple(text for text in texts if not unseen_lexemes().found_in(text))
                for kind, texts in book.items()
            }

        part = self.with_verbs(held_out().verbs, held_out=False)
        kinds = {kind: known(words) for kind, words in part.verbs.items()}
        verbs = {
            kind: {word: texts for word, texts in words.items() if texts}
            for kind, words in kinds.items()
        }
        texts: dict[str, Any] = {name: known(getattr(part, name)) for name in _TEXTS}
        return replace(part, verbs=verbs, **texts)

    @staticmethod
    def is_held_out(template: str) -> bool:
        """Return whether a template is held out. Weights depend on this split: never change it."""
        return blake2b(template.encode(), digest_size=1).digest()[0] < 21

    def pick(self, rng: np.random.Generator, kind: str) -> str:
        """Sample a template: a fixed text, or an expansion of a spoken pattern."""
        spoken = self.spoken.get(kind, ())
        if spoken and rng.random() < SPOKEN:
            return self.say(rng, spoken)
        return self.say(rng, self.templates[kind])

    def stated(self, pattern: str) -> Iterator[str]:
        """Yield every expansion of a pattern."""
        deed = _DEED.search(pattern)
        phrases = [text for texts in self.verbs[deed[1]].values() for text in texts] if deed else ()
        whole = [_DEED.sub(phrase, pattern) for phrase in phrases] if deed else [pattern]
        return (text for template in whole for text in expand(template))

    def with_verbs(self, words: Collection[str], *, held_out: bool) -> "Book":
        """Return the book without some verbs, or with no other verbs.

        `held_out`: keep those and, where a kind of request has one, no others.
        """
        verbs = {
            kind: kept
            for kind, texts in self.verbs.items()
            if (kept := {w: said for w, said in texts.items() if (w in words) == held_out})
        }
        spoken = {
            kind: tuple(text for text in texts if not (m := _DEED.search(text)) or m[1] in verbs)
            for kind, texts in self.spoken.items()
        }
        if not held_out:
            return replace(self, verbs=verbs, spoken=spoken)
        only = {kind: tuple(filter(_DEED.search, texts)) for kind, texts in spoken.items()}
        templates = {kind: only.get(kind) or texts for kind, texts in self.templates.items()}
        return replace(self, verbs=verbs, templates=templates, spoken={})

    def say(self, rng: np.random.Generator, patterns: Sequence[str]) -> str:
        """Sample an expansion of one of the patterns."""
        pattern = _drawn_text(rng, patterns)
        while found := _DEED.search(pattern):
            phrases = [text for texts in self.verbs[found[1]].values() for text in texts]
            pattern = pattern.replace(found[0], _drawn_text(rng, phrases), 1)
        return one_of(rng, pattern)


def one_of(rng: np.random.Generator, pattern: str) -> str:
    """Sample an expansion of a pattern with alternatives."""
    return _tidy(_CHOICE.sub(lambda match: _drawn_text(rng, match[1].split("|")), pattern))


def _drawn_text(rng: np.random.Generator, texts: Sequence[str]) -> str:
    return texts[int(rng.integers(len(texts)))]


def _tidy(text: str) -> str:
    return " ".join(text.split()).replace(" ,", ",").replace(" ;", ";").replace(" .", ".")


def our_book() -> Book:
    """Return the phrases that ship with the project."""
    book = _read_book(HERE / "phrases.toml")
    raw = read_toml(HERE / "spoken.toml", dict[str, Any])
    verbs = {
        kind: {word: tuple(said) for word, said in words.items()}
        for kind, words in raw.pop("verbs").items()
    }
    around = raw.pop("around")
    return replace(
        book,
        spoken={kind: tuple(texts) for kind, texts in raw.items()},
        verbs=verbs,
        around={part: (*texts, *around[part]) for part, texts in book.around.items()},
    )


def disjoint_book() -> Book:
    """Return phrases of other sentence forms and words, which no planner is trained on."""
    return _read_book(HERE / "disjoint_phrases.toml")


def _read_book(path: Path) -> Book:
    raw = read_toml(path, dict[str, Any])
    templates = {
        kind: tuple(dict.fromkeys(text for template in texts for text in expand(template)))
        for kind, texts in raw.items()
        if isinstance(texts, list)
    }
    words = {name: raw[name] for name in ("adjectives", "just", "around", "references")}
    return Book(templates=templates, **words)


def expand(text: str) -> Iterator[str]:
    """Yield every expansion of a template with alternatives.

    >>> list(expand("(open|shut) {s}"))
    ['open {s}', 'shut {s}']
    """
    parts = [part.split("|") for part in re.split(r"[()]", text)]
    for choice in product(*parts):
        yield _tidy("".join(choice))
