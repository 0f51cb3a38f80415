"""Referring expressions: an object by name, kind, state, location, history, or "it".

A noun and qualifiers are kept only if they mean the unit: the last handled unit that fits, else the
last seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.saying import plural_of
from karma.plugins.rules.language.lexemes import (
    every_word,
    pick_common,
    takes_article,
    types_called,
)
from karma.plugins.training.drawing.memories import KnownRoom, Rng, pick, place_type, weighted
from karma.plugins.training.drawing.phrases import Book
from karma.types.memory import MemoryUnit
from karma.types.planning import PlanRequest

Fits = Callable[[MemoryUnit], bool]
WEIGHTS = {"name": 0.42, "kind": 0.30, "anything": 0.14, "pronoun": 0.14}
VAGUE = {"name": 0.0, "kind": 0.55, "anything": 0.25, "pronoun": 0.20}
NAMED = {"name": 0.85, "kind": 0.0, "anything": 0.0, "pronoun": 0.15}


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Knowledge and options of sampling a request."""

    room: KnownRoom
    facts: PlanRequest  # without the instruction
    names: dict[str, str]  # object id -> short name
    book: Book
    mapped: bool  # long-term memory is there
    strict: bool = False  # words must fit one handled unit only
    vague: float = (
        0.0  # chance that a remembered thing is not called by its name; < 0: named or "it"
    )

    @property
    def units(self) -> Sequence[MemoryUnit]:
        """Short-term memory, the last used last."""
        return self.facts.units


@dataclass(frozen=True, slots=True, kw_only=True)
class Ref:
    """An object that a request names: its program name, type, and the words for it."""

    name: str
    object_type: str
    words: str  # with article, or a pronoun
    bare: str  # without
    plain: bool = True  # the bare name alone means this object


@dataclass(frozen=True, slots=True, kw_only=True)
class _Said:
    """Words before and after a noun, and which units they admit."""

    before: str = ""
    after: str = ""
    fits: Fits = lambda unit: True


def refer(rng: Rng, scene: Situation, unit: MemoryUnit) -> Ref | None:
    """Sample words that mean this unit only; return None after five tries."""
    bare = pick_common(rng, scene.book.things[base_type(unit.object_type)].names)
    weights = NAMED if scene.vague < 0 else VAGUE if rng.random() < scene.vague else WEIGHTS
    for _ in range(5):
        form = weighted(rng, weights)
        if form == "pronoun":
            text, meant = _pronoun(rng, scene)
        else:
            text, meant = _described(rng, scene, unit, form, bare)
        if meant is None or meant.object_id != unit.object_id:
            continue
        if "sliced" in unit.states and rng.random() < 0.35:
            text = f"{pick(rng, ('a slice of', 'a piece of', 'some of', 'one slice of'))} {text}"
        plain = meaning(scene, _by_name(bare)) is unit
        name = scene.names[unit.object_id]
        return Ref(name=name, object_type=unit.object_type, words=text, bare=bare, plain=plain)
    return None


def meaning(scene: Situation, *tests: Fits) -> MemoryUnit | None:
    """Return the last handled unit that fits, else the last seen.

    In a strict situation return None unless exactly one handled unit fits.
    """
    fitting = [unit for unit in scene.units if all(test(unit) for test in tests)]
    handled = [unit for unit in fitting if unit.handled]
    if scene.strict and len(handled) != 1:
        return None
    chosen = handled or fitting
    return chosen[-1] if chosen else None


def _pronoun(rng: Rng, scene: Situation) -> tuple[str, MemoryUnit | None]:
    last = next((unit for unit in reversed(scene.units) if unit.handled), None)
    return pick(rng, ("it", "it", "it", "that", "this", "that one", "this thing")), last


def _by_name(word: str) -> Fits:
    return lambda unit: word in every_word()[base_type(unit.object_type)].names


def _of_kind(word: str) -> Fits:
    return lambda unit: base_type(unit.object_type) in types_called(word)


def _described(
    rng: Rng, scene: Situation, unit: MemoryUnit, form: str, bare: str
) -> tuple[str, MemoryUnit | None]:
    """Return a noun with qualifiers, and the unit that they mean."""
    noun, tests = _noun(rng, scene, unit, form, bare)
    if not noun:
        return "", None
    chance = {"name": 0.35, "kind": 0.6, "anything": 1.0}[form]
    before, after = "", ""
    if rng.random() < chance:
        said = _qualifier(rng, scene, unit)
        if said is None:
            return "", None
        before, after = said.before, said.after
        if before and not takes_article(noun):
            before, after = "", f"that is {before}"
        tests.append(said.fits)
    text = " ".join(f"{before} {noun} {after}".split())
    if form == "anything" and after and rng.random() < 0.3:
        text = f"what {after.removeprefix('that ').removeprefix('which ')}"
        bad = not after.startswith(("you ", "that you ", "that is ", "which is ", "which you "))
        return ("", None) if bad else (text, meaning(scene, *tests))
    if form == "name" and not after:
        article = pick(rng, ("the", "the", "that", "my")) if scene.strict else ""
        return with_article(rng, text, article), meaning(scene, *tests)
    article = pick(rng, ("the", "the", "the", "that", "my")) if takes_article(noun) else ""
    return f"{article} {text}".strip(), meaning(scene, *tests)


def _noun(
    rng: Rng, scene: Situation, unit: MemoryUnit, form: str, bare: str
) -> tuple[str, list[Fits]]:
    """Return a noun of a form (or "") and its tests of a unit."""
    if form == "name":
        return bare, [_by_name(bare)]
    if form == "anything":
        return pick(rng, scene.book.references["anything"]), []
    said = describe(rng, scene, vaguely(scene, base_type(unit.object_type)))
    return (said.text, [_of_kind(said.word)]) if said else ("", [])


def _qualifier(rng: Rng, scene: Situation, unit: MemoryUnit) -> _Said | None:
    """Sample a qualifier: a state, a past action, a location, or contents."""
    if rng.random() < 0.5 and (contrast := _contrast_said(rng, scene, unit)) is not None:
        return contrast
    options = [_state_said, _done_said, _place_said, _cargo_said]
    for which in rng.permutation(len(options)):
        if (said := options[int(which)](rng, scene, unit)) is not None:
            return said
    return None


def _contrast_said(rng: Rng, scene: Situation, unit: MemoryUnit) -> _Said | None:
    """Sample a contrast with other units of the type; return None if there are none."""
    kind = base_type(unit.object_type)
    rivals = [u for u in scene.units if base_type(u.object_type) == kind and u is not unit]
    if not rivals:
        return None
    options: list[_Said] = []
    if len(rivals) == 1 and meaning(scene, lambda u: base_type(u.object_type) == kind) is not unit:
        options.append(
            _Said(before=pick(rng, ("other", "second")), fits=lambda other: other is unit)
        )
    states = [state for rival in rivals for state in rival.states if state not in unit.states]
    if states and (words := scene.book.adjectives.get(states[0].replace(" ", "_"))):
        text = f"that is {pick(rng, ('not', 'not yet', 'not'))} {pick(rng, words)}"
        options.append(_Said(after=text, fits=lambda other: states[0] not in other.states))
    handled = [other for other in scene.units if other.handled]
    if handled and handled[0] is unit and not scene.strict:
        text = f"you {pick(rng, scene.book.just['moved'])} first"
        options.append(_Said(after=text, fits=lambda other: other is unit))
    if not unit.handled and not scene.strict:
        text = pick(rng, ("you have not touched", "that you did not use", "nobody has used"))
        options.append(_Said(after=text, fits=lambda other: not other.handled))
    return pick(rng, options) if options else None


def _state_said(rng: Rng, scene: Situation, unit: MemoryUnit) -> _Said | None:
    words = scene.book.adjectives
    states = [state for state in unit.states if words.get(state.replace(" ", "_"))]
    if not states:
        return None
    state = pick(rng, states)
    word = pick(rng, words[state.replace(" ", "_")])
    if rng.random() < 0.2:
        return _Said(after=f"that is {word}", fits=lambda other: state in other.states)
    return _Said(before=word, fits=lambda other: state in other.states)


def _done_said(rng: Rng, scene: Situation, unit: MemoryUnit) -> _Said | None:
    if not unit.handled:
        return None
    states = [state for state in unit.states if scene.book.just.get(state)]
    if not states or (not scene.strict and rng.random() < 0.25):
        last = next(other for other in reversed(scene.units) if other.handled)
        text = pick(rng, scene.book.references["done"]).format(
            d=pick(rng, scene.book.just["moved"])
        )
        return _Said(after=text, fits=lambda other: other is last)
    state = pick(rng, states)
    text = pick(rng, scene.book.references["done"]).format(d=pick(rng, scene.book.just[state]))
    return _Said(after=text, fits=lambda other: state in other.states and other.handled)


def _place_said(rng: Rng, scene: Situation, unit: MemoryUnit) -> _Said | None:
    if unit.place_id is None or unit.place_id == HAND:
        return None
    place = place_type(scene.units, unit.place_id)
    if base_type(place) not in every_word():
        return None
    text = pick(rng, scene.book.references["place"]).format(
        w=pick_common(rng, scene.book.things[base_type(place)].names)
    )

    def fits(other: MemoryUnit) -> bool:
        there = other.place_id is not None and place_type(scene.units, other.place_id) == place
        return there and (other.handled or not scene.strict)

    return _Said(after=text, fits=fits)


def _cargo_said(rng: Rng, scene: Situation, unit: MemoryUnit) -> _Said | None:
    cargo = [other for other in scene.units if other.place_id == unit.object_id]
    if not cargo:
        return None
    inside = pick_common(rng, scene.book.things[base_type(cargo[-1].object_type)].names)
    text = pick(rng, scene.book.references["cargo"]).format(c=inside)
    return _Said(after=text, fits=lambda other: other is unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """A word vaguer than a name, and its phrase."""

    word: str  # of the lexicon
    text: str  # without article: "thing to write with"


def vaguely(scene: Situation, kind: str, most: int = 99) -> Sequence[str]:
    """Return the vaguer words for a type.

    `most` is how many types a word may fit.
    """
    entry = scene.book.things[kind]
    return [word for word in (*entry.kinds, *entry.uses) if len(types_called(word)) <= most]


def describe(rng: Rng, scene: Situation, words: Sequence[str]) -> Description | None:
    """Sample a vague word and its phrase; return None without words."""
    if not words:
        return None
    word = pick(rng, words)
    kind = types_called(word)[0]
    if word not in every_word()[kind].uses:
        return Description(word=word, text=word)
    return Description(word=word, text=pick(rng, scene.book.references["use"]).format(u=word))


def call(rng: Rng, scene: Situation, kind: str) -> Ref:
    """Name an object that memory lacks, by words that fit no other type."""
    said = (
        describe(rng, scene, vaguely(scene, kind, 1)) if rng.random() < scene.book.vague else None
    )
    if said is not None:
        article = "the" if rng.random() < 0.7 else "a"
        words = with_article(rng, said.text, article)
        return Ref(name=kind, object_type=kind, words=words, bare=said.text, plain=False)
    names = scene.book.things[kind].names
    names = tuple(name for name in names if len(types_called(name)) == 1) or names[:1]
    word = pick_common(rng, names)
    return Ref(name=kind, object_type=kind, words=with_article(rng, word), bare=word)


def with_article(rng: Rng, words: str, article: str = "") -> str:
    """Put an article before a name; sample it unless given."""
    if not takes_article(words):
        return words
    if not article:
        article = pick(rng, ("the", "the", "the", "the", "a", "a", "my", "that", "one of the", ""))
    if article == "one of the":
        words = plural_of(words)
    if article == "a" and words[0] in "aeiou":
        article = "an"
    return f"{article} {words}".strip()
