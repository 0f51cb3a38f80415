"""The phrase book: what people call things and how they ask for things.

Ours lies beside this file; `mine_alfred` adds the sentences of ALFRED's annotators, read where they
lie and turned into templates in memory.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from hashlib import blake2b
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from karma.files import read_toml
from karma.language.lexemes import (
    Entry,
    held_out,
    lexicon,
    unseen_lexemes,
    unseen_lexicon,
)
from karma.plugins.alfred.sentences import read_demonstrations

HERE = Path(__file__).parent
MAX_WORDS = 14  # of a mined sentence
MINED = 0.4  # share of mined templates where there are any
UNSEEN_VAGUE = 0.35  # `vague` where the words are held out: names and uses are both to be asked
SPOKEN = 0.5  # share of patterns among ours
_CHOICE = re.compile(r"\(([^()]*)\)")
_DEED = re.compile(r"<(\w+)>")


_TEXTS = (
    "templates", "mined", "spoken", "joined", "shared", "deeds", "adjectives", "just", "around",
    "references",
)  # parts of a book that are texts by kind  # fmt: skip

Texts = Mapping[str, tuple[str, ...]]
Verbs = Mapping[str, Mapping[str, tuple[str, ...]]]  # kind of deed -> word -> its phrases


@dataclass(frozen=True, slots=True, kw_only=True)
class Book:
    """Templates per kind of request, and words for states and for what was done before.

    `spoken` are patterns with their alternatives still in them, and `<clean>` for a phrase of
    `verbs`. Either side of the split has all that a pattern stands for, or nothing of it.
    """

    templates: Mapping[str, tuple[str, ...]]
    adjectives: Mapping[str, tuple[str, ...]]
    just: Mapping[str, tuple[str, ...]]
    around: Mapping[str, tuple[str, ...]]
    references: Mapping[str, tuple[str, ...]]
    mined: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    spoken: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    verbs: Verbs = field(default_factory=dict)
    joined: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # requests, and things
    shared: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # one deed, several things
    deeds: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # bare verbs
    things: Mapping[str, Entry] = field(default_factory=lexicon)  # what they are called
    vague: float = 0.12  # share of things not remembered and of places that go by no name

    def part(self, *, held_out: bool) -> "Book":
        """Return one side of the fixed split of the templates (about one in twelve held out).

        Neither side has lexemes that are held out (see `with_unseen_words`).
        """
        known = self._with_known_words()

        def side(book: Texts) -> dict[str, tuple[str, ...]]:
            return {
                kind: tuple(t for t in texts if self.is_held_out(t) == held_out)
                for kind, texts in book.items()
            }

        def side_or_all(book: Texts) -> dict[str, tuple[str, ...]]:
            return {kind: texts or book[kind] for kind, texts in side(book).items()}

        split = ("templates", "mined", "joined", "shared")
        sides: dict[str, Any] = {name: side_or_all(getattr(known, name)) for name in split}
        return replace(known, spoken=side(known.spoken), **sides)

    def with_unseen_words(self) -> "Book":
        """Return the held-out templates, with held-out words for things, states and deeds."""
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
        """Return the book without what has a held-out lexeme in it."""

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
        """Return the side of a template; it stays as it is, as weights were trained on one."""
        return blake2b(template.encode(), digest_size=1).digest()[0] < 21

    def pick(self, rng: np.random.Generator, kind: str) -> str:
        """Draw a template: one that was mined, one of ours, or what a pattern stands for."""
        mined, spoken = self.mined.get(kind, ()), self.spoken.get(kind, ())
        if mined and rng.random() < MINED:
            return _drawn_text(rng, mined)
        if spoken and rng.random() < SPOKEN:
            return self.say(rng, spoken)
        return self.say(rng, self.templates[kind])

    def stated(self, pattern: str) -> Iterator[str]:
        """Yield every template that a pattern stands for."""
        deed = _DEED.search(pattern)
        phrases = [text for texts in self.verbs[deed[1]].values() for text in texts] if deed else ()
        whole = [_DEED.sub(phrase, pattern) for phrase in phrases] if deed else [pattern]
        return (text for one in whole for text in expand(one))

    def with_verbs(self, words: Collection[str], *, held_out: bool) -> "Book":
        """Return the book without some words of `verbs`, or with no deeds but theirs.

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
        return replace(self, verbs=verbs, templates=templates, spoken={}, mined={})

    def say(self, rng: np.random.Generator, patterns: Sequence[str]) -> str:
        """Draw one of the templates that some patterns stand for."""
        pattern = _drawn_text(rng, patterns)
        while found := _DEED.search(pattern):
            phrases = [text for texts in self.verbs[found[1]].values() for text in texts]
            pattern = pattern.replace(found[0], _drawn_text(rng, phrases), 1)
        return one_of(rng, pattern)


def one_of(rng: np.random.Generator, pattern: str) -> str:
    """Draw one of the texts that a pattern with alternatives stands for."""
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
    around, *several = (raw.pop(part) for part in ("around", "joined", "shared", "deeds"))
    joined, shared, deeds = (
        {kind: tuple(texts) for kind, texts in part.items()} for part in several
    )
    return replace(
        book,
        spoken={kind: tuple(texts) for kind, texts in raw.items()},
        verbs=verbs,
        joined=joined,
        shared=shared,
        deeds=deeds,
        around={part: (*texts, *around[part]) for part, texts in book.around.items()},
    )


def disjoint_book() -> Book:
    """Return phrases of other sentence forms and words, which no planner is trained on."""
    return _read_book(HERE / "disjoint_phrases.toml")


def _read_book(path: Path) -> Book:
    raw = read_toml(path, dict[str, Any])
    templates = {
        kind: tuple(dict.fromkeys(one for text in texts for one in expand(text)))
        for kind, texts in raw.items()
        if isinstance(texts, list)
    }
    words = {name: raw[name] for name in ("adjectives", "just", "around", "references")}
    return Book(templates=templates, **words)


def expand(text: str) -> Iterator[str]:
    """Yield every text that a template with alternatives stands for.

    >>> list(expand("(open|shut) {s}"))
    ['open {s}', 'shut {s}']
    """
    parts = [part.split("|") for part in re.split(r"[()]", text)]
    for choice in product(*parts):
        yield _tidy("".join(choice))


def with_alfred(book: Book, path: Path) -> Book:
    """Return the book with ALFRED's templates added, each as often as it was said (at most 5).

    FileError if the demonstrations are missing or torn.
    """
    more: dict[str, dict[str, int]] = {}
    for kind, template in mine_alfred(path):
        counts = more.setdefault(kind, {})
        counts[template] = min(counts.get(template, 0) + 1, 5)
    mined = {
        kind: tuple(text for text, times in sorted(counts.items()) for _ in range(times))
        for kind, counts in more.items()
    }
    return replace(book, mined=mined)


def mine_alfred(path: Path) -> Iterator[tuple[str, str]]:
    """Yield (kind, template) for every human sentence that names its objects once each.

    Source: ALFRED's annotations (`turk_annotations`), goal sentences and step sentences.
    """
    for trial in read_demonstrations(path, dict[str, Any]):
        for annotation in trial["turk_annotations"]:
            yield from _goal_sentence(trial, annotation["task_desc"])
            yield from _step_sentences(trial, annotation["high_descs"])


_GOAL_KINDS = {
    "pick_and_place_simple": "place",
    "pick_clean_then_place_in_recep": "clean_place",
    "pick_heat_then_place_in_recep": "heat_place",
    "pick_cool_then_place_in_recep": "cool_place",
    "look_at_obj_in_light": "look",
    "pick_and_place_with_movable_recep": "stack",
}
_STEP_KINDS = {
    "PickupObject": "hold",
    "PutObject": "place",
    "SliceObject": "slice",
    "ToggleObject": "switch_on",
}


_MUST_SAY = {
    "clean_place": re.compile(r"clean|wash|rins|wet"),
    "heat_place": re.compile(r"hot|heat|warm|cook|microwav"),
    "cool_place": re.compile(r"cool|cold|chill"),
    "slice_place": re.compile(r"slic|cut|piece"),
    "slice": re.compile(r"slic|cut|chop"),
    "switch_on": re.compile(r"\bon\b"),
    "hold": re.compile(r"pick|take|grab|get|lift|hold"),
}  # a sentence that leaves out what is to be done teaches nothing


def _kept(kind: str, template: str | None) -> Iterator[tuple[str, str]]:
    must = _MUST_SAY.get(kind)
    if template is not None and (must is None or must.search(template)):
        yield kind, template


def _goal_sentence(trial: dict[str, Any], text: str) -> Iterator[tuple[str, str]]:
    kind = _GOAL_KINDS.get(trial["task_type"])
    wanted = trial["pddl_params"]
    if kind is None or (wanted["object_sliced"] and kind != "place"):
        return
    if wanted["object_sliced"]:
        kind = "slice_place"
    slots = {"x": wanted["object_target"], "r": wanted["parent_target"]}
    if kind == "look":
        slots = {"x": wanted["object_target"], "s": wanted["toggle_target"]}
    if kind == "stack":
        slots["m"] = wanted["mrecep_target"]
    yield from _kept(kind, make_template(text, slots))


def _step_sentences(trial: dict[str, Any], texts: list[str]) -> Iterator[tuple[str, str]]:
    steps = [step["discrete_action"] for step in trial["plan"]["high_pddl"]]
    steps = [step for step in steps if step["action"] != "NoOp"]
    if len(steps) != len(texts):
        return
    by_lower = {name.lower(): name for name in lexicon()}
    for step, text in zip(steps, texts, strict=True):
        kind = _STEP_KINDS.get(step["action"])
        arguments = [by_lower.get(word.removesuffix("sliced")) for word in step["args"]]
        if kind is None or None in arguments:
            continue
        names = [name for name in arguments if name is not None]
        slots = {"s": names[0]} if kind == "switch_on" else {"x": names[0]}
        if kind == "place" and len(names) > 1:
            slots["r"] = names[1]
        yield from _kept(kind, make_template(text, slots))


def make_template(text: str, slots: Mapping[str, str]) -> str | None:
    """Put slots where a sentence names its objects; None unless each is named exactly once.

    `{x}` stands for the words with their article, `{x0}` for the bare name after other words.

    >>> make_template("Put the mug into the sink basin.", {"x": "Mug", "r": "Sink"})
    'put {x} into {r}'
    >>> make_template("Put a clean mug in the sink.", {"x": "Mug", "r": "Sink"})
    'put a clean {x0} in {r}'
    """
    text = " ".join(re.sub(r"[^a-z0-9,' -]", " ", text.lower()).split())
    if not text or len(text.split()) > MAX_WORDS:
        return None
    for slot, kind in slots.items():
        if kind not in lexicon():
            return None
        text, count = _slot_pattern(kind).subn(
            lambda match: f"{{{slot}}}" if match[1] else f"{{{slot}0}}",  # noqa: B023 - used at once
            text,
        )
        if count != 1:
            return None
    return None if _other_things().search(text) else text


@cache
def _other_things() -> re.Pattern[str]:
    """Match the name of anything: a sentence that speaks of more than its slots is not kept."""
    words = {word for entry in lexicon().values() for word in entry.names}
    return re.compile(r"\b(?:" + "|".join(map(re.escape, sorted(words))) + r")s?\b(?![^{]*})")


@cache
def _slot_pattern(kind: str) -> re.Pattern[str]:
    words = sorted(lexicon()[kind].names, key=len, reverse=True)
    return re.compile(
        r"\b((?:the|a|an|some|one|another|his|her|your)\s+)?(?:"
        + "|".join(re.escape(word) for word in words)
        + r")s?\b(?![^{]*})"
    )
