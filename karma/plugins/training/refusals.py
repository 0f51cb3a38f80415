"""Sample requests to refuse, and near misses to carry out.

Most use the sentences and objects of requests to carry out, so that no wording tells them apart: an
object that no home has, an action that the type does not allow, a "do not". The rest is talk, other
languages and nonsense.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import msgspec

from karma.agent.planning.inspector import objection
from karma.files import read_toml
from karma.household import uses
from karma.household.pieces import base_type, is_piece
from karma.household.places import landmark_types
from karma.plugins.rules.language.lexemes import pick_common, types_called
from karma.plugins.training.drawing.memories import KnownRoom, Rng, pick, weighted
from karma.plugins.training.drawing.phrases import Book, expand, one_of
from karma.plugins.training.drawing.referring_expressions import Situation, with_article
from karma.plugins.training.drawing.requests import one_ask, pick_kind, wrapped
from karma.plugins.training.samples import (
    FEW,
    RECALLED,
    TYPOS,
    TrainingExample,
    draw,
    draw_facts,
    example_of,
    misspelt,
    situation,
)
from karma.types.planning import RefusalKind, RefusedRequest, SkillCall

HERE = Path(__file__).parent
Drawer = Callable[[Rng, Situation], str | None]
WHOLE = 0.4  # share of near misses that are sentences of their own, not words round another
TRIES = 20


class RefusedPhrases(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Patterns and words of `refusals.toml` by use."""

    words: Mapping[str, tuple[str, ...]]  # "verbs": that a request may begin with
    near: Mapping[str, tuple[str, ...]]  # templates of the phrase book, by kind of request


class OtherLanguage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Sentences of another language and their slot fillers."""

    x: tuple[str, ...]
    r: tuple[str, ...]
    asks: tuple[str, ...]
    others: tuple[str, ...]


@cache
def phrases() -> RefusedPhrases:
    """Return the words; objects and places that the lexicon knows are left out.

    Words that end in a name mean that object: a baby bottle is a bottle.
    """
    found = read_toml(HERE / "refusals.toml", RefusedPhrases)
    foreign = {name: tuple(filter(_is_foreign, found.words[name])) for name in ("things", "places")}
    return msgspec.structs.replace(found, words={**found.words, **foreign})


@cache
def languages() -> Mapping[str, OtherLanguage]:
    """Return the languages by name."""
    return read_toml(HERE / "refusal_languages.toml", dict[str, OtherLanguage])


def _is_foreign(words: str) -> bool:
    last = words.split()[-1]
    return not any(map(types_called, (words, last, last.removesuffix("s"))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A way of sampling requests to refuse."""

    kind: RefusalKind
    weight: float
    drawn: Drawer
    ours: bool = True  # it is English, and may be polite or misspelt
    bare: bool = False  # it is unclear only where nothing is remembered or in the hand


# ----------------------------------------------------------------- drawing


def draw_refusal(rng: Rng, room: KnownRoom, book: Book, *, mapped: bool) -> TrainingExample:
    """Sample a request that the planner has to refuse."""
    while True:
        facts, _ = draw_facts(rng, room, mapped=mapped)
        if facts.units and rng.random() < RECALLED:
            order = rng.permutation(len(facts.units))[:FEW]
            facts = replace(facts, units=tuple(facts.units[n] for n in sorted(order)))
        group = GROUPS[weighted(rng, {name: group.weight for name, group in GROUPS.items()})]
        if group.bare:
            facts = replace(facts, units=(), held_id=None, held_type=None)
        scene = situation(rng, room, facts, book, mapped=mapped)
        text = group.drawn(rng, scene)
        if not text:
            continue
        if group.ours:
            text = wrapped(rng, book, text)
            text = misspelt(rng, text) if rng.random() < TYPOS else text
        facts = replace(scene.facts, instruction=text)
        return example_of(f"refuse_{group.kind}", facts, f"{RefusedRequest(kind=group.kind)}\n")


def draw_near_miss(
    rng: Rng,
    room: KnownRoom,
    book: Book,
    *,
    mapped: bool,
) -> TrainingExample:
    """Sample a request that sounds like a refusal and is carried out; see `samples.draw`."""
    if rng.random() < WHOLE:
        book = replace(book, templates={**book.templates, **_near()}, spoken={})
        return draw(rng, room, book, mapped=mapped)
    return draw(rng, room, book, mapped=mapped, told=_heeded)


@cache
def _near() -> Mapping[str, tuple[str, ...]]:
    near = phrases().near
    return {
        kind: tuple(text for template in near[kind] for text in expand(template)) for kind in near
    }


def _heeded(rng: Rng, scene: Situation, text: str) -> str:
    """Add words around a request that do not change it."""
    for _ in range(TRIES):
        pattern = pick(rng, phrases().words["heeded"])
        if "{ask}" in pattern and text.split()[0] not in phrases().words["verbs"]:
            continue
        told = _Slots(rng, scene, request=text).fill(pattern)
        if told is not None:
            return told
    return text


class _Slots(dict[str, str]):
    """Slot fillers, sampled anew for every slot."""

    def __init__(self, rng: Rng, scene: Situation, request: str | None = None) -> None:
        self._rng, self._scene, self._request = rng, scene, request

    def fill(self, pattern: str) -> str | None:
        """Fill a pattern; return None if a slot has no filler."""
        try:
            return one_of(self._rng, pattern).format_map(self)
        except LookupError:
            return None

    def __missing__(self, slot: str) -> str:
        """Sample the filler of a slot; LookupError if there is none."""
        return _DRAWN[slot](self._rng, self._scene, self._request)


def _from(group: str) -> Drawer:
    """Return the sampler of a group's patterns."""
    return lambda rng, scene: _Slots(rng, scene).fill(pick(rng, phrases().words[group]))


# ----------------------------------------------------------------- what patterns are filled with


def _any_type(rng: Rng, scene: Situation) -> str:
    """Sample a type: remembered, of the room, or any."""
    remembered = [base_type(unit.object_type) for unit in scene.units]
    here = (*scene.room.movables, *scene.room.landmarks)
    pool = pick(rng, (remembered, here, here, tuple(scene.book.things)))
    named = [name for name in pool or here if name in scene.book.things]
    if not named:
        raise LookupError("a thing to name")
    return pick(rng, named)


def _name(rng: Rng, scene: Situation, kind: str) -> str:
    return pick_common(rng, scene.book.things[kind].names)


def _place(rng: Rng, scene: Situation) -> str:
    there = scene.room.landmarks if scene.mapped else sorted(landmark_types())
    named = [kind for kind in there if kind in scene.book.things]
    if not named:
        raise LookupError("a place to name")
    return pick(rng, named)


def _foreign_thing(rng: Rng) -> str:
    word = pick(rng, phrases().words["things"])
    articles = ("the", "the", "my", "some") if word.endswith("s") else ("the", "the", "my", "a")
    return with_article(rng, word, pick(rng, articles))


def _request(rng: Rng, scene: Situation) -> str:
    """Sample a request to carry out that begins with a verb."""
    for _ in range(TRIES):
        ask = one_ask(rng, scene, pick_kind(rng))
        if ask is not None and ask.text.split()[0] in phrases().words["verbs"]:
            return ask.text
    raise LookupError("a request")


def _other(rng: Rng, scene: Situation, request: str | None) -> str:
    """Sample an object that a request does not mention."""
    for _ in range(TRIES):
        word = _name(rng, scene, _any_type(rng, scene))
        if not set(word.split()) & set(re.findall(r"\w+", request or "")):
            return f"the {word}"
    raise LookupError("another thing")


def _invented(rng: Rng) -> str:
    return "".join(pick(rng, phrases().words["syllables"]) for _ in range(int(rng.integers(2, 4))))


_DRAWN: Mapping[str, Callable[[Rng, Situation, str | None], str]] = {
    "x": lambda rng, scene, _: with_article(rng, _name(rng, scene, _any_type(rng, scene))),
    "x0": lambda rng, scene, _: _name(rng, scene, _any_type(rng, scene)),
    "r": lambda rng, scene, _: f"the {_name(rng, scene, _place(rng, scene))}",
    "y": lambda rng, *_: pick(rng, phrases().words["things"]),
    "being": lambda rng, *_: pick(rng, phrases().words["beings"]),
    "name": lambda rng, *_: pick(rng, phrases().words["names"]),
    "topic": lambda rng, *_: pick(rng, phrases().words["topics"]),
    "town": lambda rng, *_: pick(rng, phrases().words["towns"]),
    "n": lambda rng, *_: pick(rng, phrases().words["numbers"]),
    "w": lambda rng, *_: _invented(rng),
    "ask": lambda rng, scene, request: request or _request(rng, scene),
    "said": lambda rng, scene, request: request or _request(rng, scene),
    "other": _other,
}


# ----------------------------------------------------------------- sentences of the phrase book

_FOREIGN_IN = {
    "place": 10.0, "hold": 6.0, "clean": 2.0, "slice": 1.0, "trash": 2.0, "open": 1.0,
    "switch_on": 1.0, "heat": 1.0, "break": 1.0, "fill": 1.0, "clean_place": 1.0,
}  # fmt: skip
_CANNOT = {
    "place": 8.0, "hold": 5.0, "slice": 5.0, "open": 4.0, "close": 2.0, "switch_on": 4.0,
    "switch_off": 2.0, "break": 2.0, "fill": 3.0, "trash": 2.0, "clean": 2.0,
    "heat": 3.0, "cool": 2.0,
}  # fmt: skip
_ACTS = {
    "slice": "SliceObject", "open": "OpenObject", "close": "CloseObject", "switch_on": "ToggleOn",
    "switch_off": "ToggleOff", "break": "BreakObject", "fill": "EmptyObject",
}  # fmt: skip
_INTO = {"clean": uses.SINK, "heat": uses.MICROWAVE, "cool": uses.FRIDGE, "trash": uses.BIN}


def _template(rng: Rng, scene: Situation, kind: str, x: str, r: str) -> str | None:
    """Fill a template of the phrase book with unrelated words."""
    bare = x.partition(" ")[2]
    slots = {"x": x, "x0": bare, "x2": "it", "s": x, "s0": bare, "s2": "it", "r": r, "r0": r[4:]}
    try:
        return scene.book.pick(rng, kind).format(**slots)
    except KeyError:
        return None


def _no_such_thing(rng: Rng, scene: Situation) -> str | None:
    kind = weighted(rng, _FOREIGN_IN)
    return _template(rng, scene, kind, _foreign_thing(rng), _DRAWN["r"](rng, scene, None))


def _no_such_place(rng: Rng, scene: Situation) -> str | None:
    known, place = _DRAWN["x"](rng, scene, None), f"the {pick(rng, phrases().words['places'])}"
    return _template(rng, scene, "place", known, place)


def _impossible(rng: Rng, scene: Situation) -> str | None:
    """Ask for an action that no type of the words allows."""
    kind = weighted(rng, _CANNOT)
    word = _name(rng, scene, _any_type(rng, scene))
    place = _name(rng, scene, _INTO.get(kind) or _place(rng, scene))
    places = types_called(place) if kind not in _INTO else (_INTO[kind],)
    if not all(_cannot(kind, thing, r) for thing, r in product(types_called(word), places)):
        return None
    return _template(rng, scene, kind, f"the {word}", f"the {place}")


def _cannot(kind: str, thing: str, place: str) -> bool:
    """Return whether the table of types forbids a request."""
    if is_piece(thing):
        return False
    if kind in _ACTS:
        calls = [SkillCall(skill=_ACTS[kind], objects=(thing,))]
    else:
        calls = [SkillCall(skill="PickupObject", objects=(thing,))]
        if kind != "hold":
            calls.append(SkillCall(skill="PutObject", objects=(thing, place)))
    found = objection(calls, held=None)
    return found is not None and found.lasting


# ----------------------------------------------------------------- other languages, and none


def _foreign(rng: Rng, _: Situation) -> str:
    language = pick(rng, tuple(languages().values()))
    text = pick(rng, language.asks if rng.random() < 0.8 else language.others)
    return text.format(x=pick(rng, language.x), r=pick(rng, language.r))


def _letters(rng: Rng, _: Situation) -> str:
    return pick(rng, phrases().words["letters"])


GROUPS: Mapping[str, Group] = {
    "talk": Group(kind="deed", weight=0.05, drawn=_from("talk")),
    "ask": Group(kind="deed", weight=0.07, drawn=_from("ask")),
    "tell": Group(kind="deed", weight=0.03, drawn=_from("tell")),
    "errands": Group(kind="deed", weight=0.08, drawn=_from("errands")),
    "deeds": Group(kind="deed", weight=0.09, drawn=_from("deeds")),
    "things": Group(kind="thing", weight=0.11, drawn=_no_such_thing),
    "beings": Group(kind="thing", weight=0.03, drawn=_from("beings_asks")),
    "places": Group(kind="place", weight=0.06, drawn=_no_such_place),
    "harm": Group(kind="impossible", weight=0.04, drawn=_from("harm")),
    "types": Group(kind="impossible", weight=0.12, drawn=_impossible),
    "nots": Group(kind="negated", weight=0.07, drawn=_from("nots")),
    "kept": Group(kind="negated", weight=0.05, drawn=_from("kept")),
    "off": Group(kind="negated", weight=0.02, drawn=_from("off")),
    "unclear": Group(kind="unclear", weight=0.03, drawn=_from("unclear"), bare=True),
    "cut_off": Group(kind="unclear", weight=0.03, drawn=_from("cut_off")),
    "nouns_only": Group(kind="unclear", weight=0.01, drawn=_from("nouns_only")),
    "letters": Group(kind="language", weight=0.005, drawn=_letters, ours=False),
    "invented": Group(kind="language", weight=0.015, drawn=_from("invented"), ours=False),
    "foreign": Group(kind="language", weight=0.10, drawn=_foreign, ours=False),
}
"""Sampling methods by name. Weights add up to about 1."""
