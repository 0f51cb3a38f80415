"""Chooses the lexemes that are held out, by a rule and not by hand.

A lexeme can be held out if the weights that training starts from never saw its words in a row:
neither in our own words and phrases as they were then nor in what ALFRED's annotators said. Of
those a third is, by a hash of the text; and with it each text that has it as a part.
"""

import json
import re
import subprocess
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Any

from karma.errors import FileError
from karma.files import write_atomic
from karma.household.types import object_types
from karma.tasks.demonstrations import read_demonstrations
from karma.tasks.drawing.lexicon import HELD_OUT, Entry, Lexemes, UnseenWords, plain_words
from karma.tasks.drawing.phrases import Book, expand
from karma.tasks.drawing.requests import LOOKS, SWITCHED, WHERE
from karma.training.planner.sources import Sources

ONE_IN = 3
START = "63b4398"  # whose words and phrases the first weights that ship were trained on
_HEAD = """# Lexemes that no planner is trained on, chosen by rule. To write it again:
#   karma.training.planner.choosing.write_held_out
"""


def choose(words: Mapping[str, Entry], book: Book, seen: Iterable[str]) -> UnseenWords:
    """Return what is held out.

    Args:
        words: for each type.
        book: whose verbs and adjectives are lexemes, too.
        seen: what the weights that training starts from were trained on.
    """
    classes = candidates(words, book)
    every = frozenset(chain.from_iterable(classes.values()))
    finder = Lexemes(every)
    known = frozenset(text for sentence in seen for text in finder.found_in(sentence))
    known = _alike(every, known)
    comes_about = _by_chance(frozenset(chain.from_iterable(classes.values())), book)
    drawn = [
        text for text in every if text not in known and is_drawn(text) and not comes_about(text)
    ]
    parts = Lexemes(drawn)
    out = {text for text in every if parts.found_in(text)}
    return UnseenWords(
        **{name: tuple(t for t in texts if t in out) for name, texts in classes.items()}
    )


def trained_on_before(sources: Sources) -> Iterator[str]:
    """Yield every text that the first weights were trained on, as far as it has words for things.

    Raises:
        FileError: ALFRED's training split is not at hand, or the project's history.
    """
    folder = HELD_OUT.parent
    for name in ("lexicon.toml", "phrases.toml"):
        yield from texts_of(tomllib.loads(_as_it_was(folder / name)))
    for name in object_types():  # as prompts and programs have them, and as words
        yield from (name, re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    yield from chain(LOOKS, WHERE, SWITCHED)
    for trial in read_demonstrations(sources.demonstrations, dict[str, Any]):
        for annotation in trial["turk_annotations"]:
            yield annotation["task_desc"]
            yield from annotation["high_descs"]


def _as_it_was(path: Path) -> str:
    """Return a file of ours as it was when the first weights were trained."""
    command = ["git", "show", f"{START}:./{path.name}"]
    try:
        return subprocess.run(
            command, cwd=path.parent, capture_output=True, text=True, check=True
        ).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise FileError(path, f"its text at commit {START} is not in the history here") from error


def write_held_out(path: Path, chosen: UnseenWords) -> None:
    """Write the lexemes that are held out as TOML, one to a line."""
    lines = [_HEAD]
    for name in UnseenWords.__struct_fields__:
        texts = "".join(
            f"  {json.dumps(one, ensure_ascii=False)},\n" for one in getattr(chosen, name)
        )
        lines.append(f"{name} = [\n{texts}]\n")
    write_atomic(path, "".join(lines).encode())


def is_drawn(text: str) -> bool:
    """Return whether a text is among the third that is held out, if it can be."""
    return int(sha256(text.encode()).hexdigest(), 16) % ONE_IN == 0


def candidates(words: Mapping[str, Entry], book: Book) -> dict[str, tuple[str, ...]]:
    """Return all lexemes by class, each once, sorted."""
    entries = words.values()
    found: dict[str, Iterable[str]] = {
        "names": chain.from_iterable(entry.names for entry in entries),
        "kinds": chain.from_iterable(entry.kinds for entry in entries),
        "uses": chain.from_iterable(entry.uses for entry in entries),
        "adjectives": chain.from_iterable((*book.adjectives.values(), *book.just.values())),
        "verbs": chain.from_iterable(book.verbs.values()),
    }
    classes: dict[str, tuple[str, ...]] = {}
    for name, texts in found.items():
        before = frozenset(chain.from_iterable(classes.values()))
        classes[name] = tuple(sorted(set(texts) - before))
    return classes


def texts_of(raw: object) -> Iterator[str]:
    """Yield every text of a TOML file as it can be said, alternatives told apart."""
    if isinstance(raw, str):
        yield from expand(raw)
    elif isinstance(raw, Mapping):
        yield from chain.from_iterable(map(texts_of, raw.values()))
    elif isinstance(raw, list):
        yield from chain.from_iterable(map(texts_of, raw))


def _alike(every: Iterable[str], known: frozenset[str]) -> frozenset[str]:
    """Return the texts whose words are those of a known one, plurals and hyphens apart."""
    rows = {plain_words(text) for text in known}
    return frozenset(text for text in every if plain_words(text) in rows)


def _by_chance(every: frozenset[str], book: Book) -> Callable[[str], bool]:
    """Return what says whether a text may come about in a template: "heat food in", "cold tap"."""
    said = chain.from_iterable(
        chain.from_iterable(part.values())
        for part in (book.templates, book.spoken, book.around, book.references)
    )
    said = chain(said, chain.from_iterable((*book.adjectives.values(), *book.just.values())))
    usual = frozenset(word for text in said for word in plain_words(text))
    rows = frozenset(map(plain_words, every))

    def comes_about(text: str) -> bool:
        words = plain_words(text)
        pieces = [
            (start, end)
            for start in range(len(words))
            for end in range(start + 1, len(words) + 1)
            if words[start:end] in rows and end - start < len(words)
        ]
        inside = {at for start, end in pieces for at in range(start, end)}
        rest = {word for at, word in enumerate(words) if at not in inside}
        return bool(inside) and bool(rest) and rest <= usual

    return comes_about
