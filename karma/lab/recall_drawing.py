"""Draws questions to a recall in the words of a phrase book: those that training lacks, or others.

Composite: a thing by its name, to be put where another thing lies. Complex: a name or a vaguer word
with a state, and a rival of the same type without it; or "it". Vague: a kind or a use alone. What a
word may mean is what the lexicon says, so a question is as right as that.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice

from karma.contracts import MemoryUnit
from karma.household.places import ROOMS
from karma.household.states import NEEDS, OPPOSITES
from karma.household.types import object_types
from karma.lab.recall_questions import RecallQuestion, rooms_of
from karma.seeds import stream
from karma.tasks.drawing.lexicon import Entry, every_word, held_out, takes_article, types_called
from karma.tasks.drawing.memories import Rng, draw_unit, pick
from karma.tasks.drawing.phrases import Book, our_book

PUT = ("put {x} on the {d}", "place {x} on the {d}", "leave {x} by the {d}", "take {x} to the {d}")
FETCH = (
    "bring me {x}", "get {x}", "find {x} and hand it over", "pick up {x}", "go and grab {x}",
    "could you fetch {x} please", "i need {x}", "look for {x}",
)  # fmt: skip
REFER = ("put it on the {d}", "take it to the {d}", "now pick it up", "bring it here", "use it")
PLACES = {
    "CounterTop": "counter", "DiningTable": "dining table", "Shelf": "shelf", "Sofa": "sofa",
    "Bed": "bed", "Desk": "desk", "Dresser": "dresser", "SideTable": "side table",
    "CoffeeTable": "coffee table",
}  # fmt: skip
USE = "something to "
ANYTHING = ("thing", "item", "object", "stuff", "product")  # heads that say nothing
FEWEST = 6  # types left in a kind of room beside those that a word may mean
PRONOUNS = 0.1  # of the complex ones
OTHERS = 3  # more things that were handled before


@dataclass(frozen=True, slots=True, kw_only=True)
class _Draw:
    """What a question is about: a word, a type that it fits, and where such a thing is."""

    word: str
    thing: str
    room: str

    @property
    def fits(self) -> frozenset[str]:
        """Return all types that the word fits, or might: one of their words has the same head."""
        word, use = self.word.removeprefix(USE), self.word.startswith(USE)
        head = word.split()[0] if use else head_of(word)
        like = _types_by_head().get(head, ()) if head not in ANYTHING else ()
        return frozenset((self.thing, *types_called(word), *like))


@cache
def _types_by_head() -> Mapping[str, frozenset[str]]:
    """Return head word of a kind, or first word of a use -> the types that have such a word."""
    found: dict[str, set[str]] = {}
    for thing, entry in every_word().items():
        for head in (*(use.split()[0] for use in entry.uses), *map(head_of, entry.kinds)):
            found.setdefault(head, set()).add(thing)
    return {head: frozenset(things) for head, things in found.items()}


def draw_questions(each: int, *, unseen: bool, seed: int = 0) -> list[RecallQuestion]:
    """Return questions of every class, no word twice in a class.

    Args:
        each: questions of a class, fewer if there are not so many words.
        unseen: ask in the words that training lacks, or else in those that it has.
        seed: of the draw.
    """
    book = our_book().with_unseen_words() if unseen else our_book().part(held_out=False)
    found = []
    for kind, ask in (("composite", _composite), ("complex", _complex), ("vague", _vague)):
        rng = stream(seed, "recall questions", kind)
        asked = (ask(rng, draw, book) for draw in _draws(rng, kind, book, unseen=unseen))
        found += list(islice((one for one in asked if one is not None), each))
    return found


def _draws(rng: Rng, kind: str, book: Book, *, unseen: bool) -> Iterator[_Draw]:
    """Yield every word that a class may ask in, in any order, with a type that it fits."""
    pairs = [
        (word, thing)
        for thing, entry in book.things.items()
        if _rooms_with(thing)
        for word in _words(entry, kind)
        if (word.removeprefix(USE) in held_out().things) == unseen
    ]
    rng.shuffle(pairs)
    for word, thing in dict(pairs).items():
        draw = _Draw(word=word, thing=thing, room=pick(rng, _rooms_with(thing)))
        if len(set(_movables(draw))) >= FEWEST:
            yield draw


def _words(entry: Entry, kind: str) -> Sequence[str]:
    uses = tuple(f"{USE}{use}" for use in entry.uses)
    if kind == "composite":
        return entry.names
    return (*entry.kinds, *uses) if kind == "vague" else (*entry.names, *entry.kinds)


@cache
def _rooms_with(thing: str) -> Sequence[str]:
    return [kind for kind in ROOMS if any(thing in room.movables for room in rooms_of(kind))]


# ----------------------------------------------------------------- the classes


def _composite(rng: Rng, draw: _Draw, book: Book) -> RecallQuestion:
    place = pick(rng, sorted(PLACES))
    right, (first, *rest) = _told(rng, draw)
    there = replace(first, place_id=f"{place}|1")
    text = pick(rng, PUT).format(x=_noun(draw.word), d=PLACES[place])
    return _question(rng, ("composite",), draw, text, [right, there, *rest])


def _vague(rng: Rng, draw: _Draw, book: Book) -> RecallQuestion:
    right, others = _told(rng, draw)
    return _question(rng, ("vague",), draw, _asked(rng, _noun(draw.word)), [right, *others])


def _complex(rng: Rng, draw: _Draw, book: Book) -> RecallQuestion | None:
    right, others = _told(rng, draw)
    if rng.random() < PRONOUNS:
        text = pick(rng, REFER).format(d=PLACES[pick(rng, sorted(PLACES))])
        return _question(None, ("complex", "complex pronoun"), draw, text, [right, *others])
    states = [state for state in sorted(book.adjectives) if _can_be(draw.thing, state)]
    if not states:
        return None
    state = pick(rng, states)
    other = OPPOSITES.get(_plain(state))
    rival = replace(right, object_id="rival", states=(other,) if other else ())
    right = replace(right, states=(_plain(state),))
    noun = _noun(f"{pick(rng, book.adjectives[state])} {draw.word}")
    told = [right, rival, *others]
    return _question(rng, ("complex", "complex state"), draw, _asked(rng, noun), told)


def _told(rng: Rng, draw: _Draw) -> tuple[MemoryUnit, list[MemoryUnit]]:
    """Return what is meant, and things that were handled besides, which the word does not fit."""
    room = pick(rng, rooms_of(draw.room))
    kinds = _movables(draw)
    chosen = [draw.thing, *(pick(rng, kinds) for _ in range(OTHERS))]
    right, *others = (
        replace(draw_unit(rng, room, kind, 0, (), handled=True), object_id=f"told{number}")
        for number, kind in enumerate(chosen)
    )
    return right, others


def _movables(draw: _Draw) -> Sequence[str]:
    """Return the things of a kind of room that a word does not mean, as often as there are."""
    fits = draw.fits
    return [kind for one in rooms_of(draw.room) for kind in one.movables if kind not in fits]


def _question(
    rng: Rng | None, kinds: tuple[str, ...], draw: _Draw, text: str, told: list[MemoryUnit]
) -> RecallQuestion:
    """Return a question about the first of some units, put in any order, or the first put last."""
    right = told[0].object_id
    told = [*told[1:], told[0]]
    if rng is not None:
        rng.shuffle(told)
    return RecallQuestion(
        name=f"{kinds[-1]}/{draw.word}",
        group=draw.word,
        kinds=kinds,
        text=text,
        room=draw.room,
        told=tuple(told),
        right=frozenset((right,)),
        barred_types=draw.fits,
    )


def _asked(rng: Rng, noun: str) -> str:
    place = PLACES[pick(rng, sorted(PLACES))]
    return pick(rng, (*PUT, *FETCH)).format(x=noun, d=place)


def _noun(words: str) -> str:
    return f"the {words}" if takes_article(words) else words


def head_of(noun: str) -> str:
    """Return the word that says what a thing is.

    >>> head_of("sharp tool"), head_of("tool for cutting"), head_of("thing with a spout")
    ('tool', 'tool', 'thing')
    """
    return re.split(r" (?:for|with|of|from|in|that|to) ", noun)[0].split()[-1]


def _plain(state: str) -> str:
    return state.replace("_", " ")


def _can_be(thing: str, state: str) -> bool:
    """Return whether things of a type may be in a state, as far as AI2-THOR has it."""
    needs = {**NEEDS, "cleaned": "dirtyable", "heated": "cookable"}.get(_plain(state))
    return needs is not None and object_types()[thing].can(needs)
