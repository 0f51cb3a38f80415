"""Sample a request: its objects, goals and sentence."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from karma.household import uses
from karma.household.containment import goes_in
from karma.household.pieces import EGG, base_type, is_piece
from karma.household.places import LIKELY, landmark_types
from karma.household.saying import plural_of
from karma.household.types import object_types, types_with
from karma.plugins.rules.language.lexemes import every_word, lexicon, pick_common, types_called
from karma.plugins.training.drawing.memories import Rng, pick
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.drawing.referring_expressions import (
    Ref,
    Situation,
    call,
    describe,
    refer,
    vaguely,
    with_article,
)
from karma.types.tasks import Goal

ENDS_IN = {
    "clean_place": (uses.SINK,), "heat_place": (uses.MICROWAVE,), "cook_place": (uses.MICROWAVE,),
    "cool_place": (uses.FRIDGE,),
}  # where the change itself leaves the thing  # fmt: skip

NEEDS = {
    "clean": uses.SINK, "fill": uses.SINK, "heat": uses.MICROWAVE, "cook": uses.MICROWAVE,
    "cool": uses.FRIDGE, "toast": uses.TOASTER, "coffee": uses.COFFEE_MACHINE, "trash": uses.BIN,
}  # what a room must have for it  # fmt: skip
STATE_AFTER = {
    "clean": "clean", "heat": "heated", "cook": "cooked", "cool": "cold", "slice": "sliced",
    "toast": "cooked", "fill": "filled", "break": "broken",
}  # kind of request -> state of a goal  # fmt: skip
KINDS = {
    "place": 26, "trash": 5, "clean": 9, "clean_place": 4, "heat": 4, "cook": 4, "heat_place": 3,
    "cook_place": 3, "cool": 3, "cool_place": 3, "slice": 8, "slice_place": 4, "toast": 1.5,
    "fill": 4, "coffee": 2.5, "switch_on": 6, "switch_off": 4, "open": 4, "close": 4, "hold": 15,
    "look": 4, "break": 2, "stack": 4,
}  # fmt: skip
FITS = 3  # types that a vague word for a place or an unknown thing may fit
PAIR = "pair"  # two objects of a type to the same receptacle; sampled only on demand
WITH_PAIRS = {**KINDS, PAIR: 5}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask:
    """A sampled request."""

    kind: str
    text: str
    goals: tuple[Goal, ...]


def wrapped(rng: Rng, book: Book, text: str) -> str:
    """Add filler words before or after."""
    if rng.random() < 0.2:
        text = f"{pick(rng, book.around['before'])} {text}"
    if rng.random() < 0.15:
        text = f"{text} {pick(rng, book.around['after'])}".replace(" ,", ",")
    return text


def pick_kind(rng: Rng, kinds: Mapping[str, float] = KINDS) -> str:
    """Sample a kind of request by its weight."""
    weights = np.array(list(kinds.values()))
    return tuple(kinds)[int(np.searchsorted(np.cumsum(weights), rng.random() * weights.sum()))]


def one_ask(rng: Rng, scene: Situation, kind: str) -> Ask | None:
    """Sample a request of a kind; return None if the room offers none."""
    if kind in ("switch_on", "switch_off", "open", "close"):
        return _switch_ask(rng, scene, kind)
    return _pair_ask(rng, scene) if kind == PAIR else _thing_ask(rng, scene, kind)


def _thing_ask(rng: Rng, scene: Situation, kind: str) -> Ask | None:
    """Ask for an action on a movable object."""
    needed = NEEDS.get(kind.removesuffix("_place"))
    if scene.mapped and needed is not None and needed not in scene.room.landmarks:
        return None
    x = _draw_ref(rng, scene, kind)
    if x is None:
        return None
    slots = {**_slots("x", x), "x2": "it"}
    goals: list[Goal] = list(_state_goals(kind, x))
    if kind == "look":
        there = scene.room.landmarks if scene.mapped else uses.LAMPS
        lamp = _pick_landmark(rng, scene, tuple(name for name in uses.LAMPS if name in there))
        if lamp is None:
            return None
        slots |= {**_slots("s", lamp), "s2": "it"}
        goals = [_goal("HOLDON", "robot", x.name), _goal("TOGGLEON", lamp.name)]
    if kind == "trash":
        goals = [_goal("INSIDE", x.name, uses.BIN)]
        bin_ = _pick_landmark(rng, scene, (uses.BIN,))
        if bin_ is None:
            return None
        slots["r"] = bin_.words
    if kind == "place" or kind.endswith("_place") or kind == "stack":
        placed = _placement(rng, scene, kind, x, slots)
        if placed is None:
            return None
        goals += placed
    text = filled(scene.book.pick(rng, kind), slots)
    return Ask(kind=kind, text=text, goals=tuple(goals)) if text else None


def _pair_ask(rng: Rng, scene: Situation) -> Ask | None:
    """Ask for two objects of a type that memory lacks, in the same receptacle."""
    here = set(scene.room.several if scene.strict else scene.room.movables) - _remembered(scene)
    pool = [name for name in sorted(here) if name in lexicon()]
    if not pool:
        return None
    name = pick(rng, pool)
    word = pick_common(rng, scene.book.things[name].names)
    x = Ref(name=name, object_type=name, words=with_article(rng, word, "a"), bare=word)
    r = _draw_receptacle(rng, scene, x, movable=False)
    if r is None or r.name not in LIKELY:  # these hold more than one object
        return None
    slots = {**_slots("x", x), **_slots("r", r), "xs": plural_of(word)}
    text = filled(scene.book.pick(rng, PAIR), slots)
    goal = Goal(predicate="ON", arguments=(x.name, r.name), count=2)
    return Ask(kind=PAIR, text=text, goals=(goal,)) if text else None


def _remembered(scene: Situation) -> set[str]:
    held = base_type(scene.facts.held_type or "")
    return {held, *(base_type(unit.object_type) for unit in scene.units)}


def _slots(slot: str, ref: Ref) -> dict[str, str]:
    """Return the words of a slot; the bare form only if it means the same object."""
    return {slot: ref.words} | ({f"{slot}0": ref.bare} if ref.plain else {})


def filled(template: str, slots: Mapping[str, str]) -> str | None:
    """Fill a template; return None if a slot has no words."""
    try:
        return template.format(**slots)
    except KeyError:
        return None


def _state_goals(kind: str, x: Ref) -> tuple[Goal, ...]:
    state = STATE_AFTER.get(kind.removesuffix("_place"))
    if kind == "hold":
        return (_goal("HOLDON", "robot", x.name),)
    if kind == "coffee":
        return (_goal("STATE", x.name, "filled"), _goal("TOGGLEON", uses.COFFEE_MACHINE))
    if kind == "slice_place" and is_piece(x.object_type):
        return ()
    return (_goal("STATE", x.name, state),) if state else ()


def _placement(
    rng: Rng, scene: Situation, kind: str, x: Ref, slots: dict[str, str]
) -> list[Goal] | None:
    """Sample where to put it; fills the slots; None if nothing fits."""
    goals: list[Goal] = []
    top = x
    if kind == "stack":
        m = _draw_receptacle(rng, scene, x, movable=True)
        if m is None:
            return None
        goals.append(_goal("ON", x.name, m.name))
        slots |= {**_slots("m", m), "m2": "it"}
        top = m
    r = _draw_receptacle(rng, scene, top, movable=kind != "stack" and rng.random() < 0.25)
    if r is None or r.name in ENDS_IN.get(kind, ()) or r.name == x.name:
        return None
    slots |= _slots("r", r)
    return [*goals, _goal("ON", top.name, r.name)]


def _switch_ask(rng: Rng, scene: Situation, kind: str) -> Ask | None:
    capability = "openable" if kind in ("open", "close") else "toggleable"
    landmarks = tuple(
        name
        for name in (scene.room.landmarks if scene.mapped else sorted(landmark_types()))
        if capability in object_types()[name].capabilities
        or (capability == "toggleable" and name == uses.BURNER)
    )
    movables = [u for u in scene.units if capability in object_types()[u.object_type].capabilities]
    thing: Ref | None
    away = _carried(scene, capability)
    if movables and (rng.random() < 0.25 or not landmarks):
        thing = refer(rng, scene, movables[int(rng.integers(len(movables)))])
    elif away and rng.random() < 0.3:
        thing = call(rng, scene, pick(rng, away))
    else:
        thing = _pick_landmark(rng, scene, landmarks)
    if thing is None:
        return None
    predicate = {
        "switch_on": "TOGGLEON", "switch_off": "TOGGLEOFF", "open": "OPEN", "close": "CLOSED",
    }[kind]  # fmt: skip
    slots = _slots("s", thing)
    text = filled(scene.book.pick(rng, kind), slots)
    goals = (_goal(predicate, thing.name),)
    return Ask(kind=kind, text=text, goals=goals) if text else None


def _carried(scene: Situation, capability: str) -> tuple[str, ...]:
    """Return movable types with a capability that memory lacks."""
    remembered = _remembered(scene)
    return tuple(
        name
        for name in sorted(_movable_types() - remembered)
        if not scene.strict or name in scene.room.movables
        if capability in object_types()[name].capabilities
    )


def _draw_ref(rng: Rng, scene: Situation, kind: str) -> Ref | None:
    """Sample the object of a request: from memory, the room, or all types."""
    known = [u for u in scene.units if suits(kind, u.object_type)]
    if known and rng.random() < 0.75:
        return refer(rng, scene, known[int(rng.integers(len(known)))])
    remembered = _remembered(scene)
    here = scene.strict or rng.random() < 0.85
    pool = scene.room.movables if here else tuple(sorted(_movable_types()))
    away = [k for k in pool if k in lexicon() and k not in remembered and suits(kind, k)]
    if not away:
        return None
    name = pick(rng, away)
    if (
        not scene.strict
        and rng.random() < 0.06
        and (guess := _vague_unknown(rng, name, scene)) is not None
    ):
        return guess
    return call(rng, scene, name)


def _vague_unknown(rng: Rng, name: str, scene: Situation) -> Ref | None:
    """Name something vaguely that memory does not hold: it means the first type of that kind."""
    said = describe(rng, scene, vaguely(scene, name, FITS))
    if said is None or not _remembered(scene).isdisjoint(types_called(said.word)):
        return None
    first = types_called(said.word)[0]
    words = with_article(rng, said.text, "the")
    return Ref(name=first, object_type=first, words=words, bare=said.text, plain=False)


@cache
def _movable_types() -> frozenset[str]:
    return types_with("pickupable") & set(lexicon())


@cache
def suits(kind: str, object_type: str) -> bool:
    """Return whether a kind of request makes sense for a type."""
    info = object_types()[object_type]
    base = base_type(object_type)
    sort = kind.removesuffix("_place")
    if sort == "slice":
        if base == EGG:
            return False
        return bool(info.slices_into) or (kind == "slice_place" and object_type != base)
    checks = {
        "clean": goes_in(object_type, uses.SINK),
        "heat": goes_in(object_type, uses.MICROWAVE),
        "cook": object_type in uses.COOKED,
        "cool": goes_in(object_type, uses.FRIDGE),
        "toast": base == uses.TOASTED,
        "fill": "canFillWithLiquid" in info.capabilities and goes_in(object_type, uses.SINK),
        "coffee": base == uses.COFFEE_CUP,
        "break": "breakable" in info.capabilities,
        "trash": goes_in(object_type, uses.BIN),
    }
    return checks.get(sort, True)


def _draw_receptacle(rng: Rng, scene: Situation, x: Ref, *, movable: bool) -> Ref | None:
    """Sample a receptacle: a landmark, or a movable one from memory or the room.

    Half of the samples take any receptacle, sensible or not: a model that can guess the receptacle
    from the object never learns to read it.
    """
    info = object_types()[x.object_type]
    anything = rng.random() < 0.5 and not scene.strict
    fits = [
        name
        for name, kind in object_types().items()
        if (goes_in(info.name, name) or (anything and "receptacle" in kind.capabilities))
    ]
    if not movable:
        there = scene.room.landmarks if scene.mapped else sorted(landmark_types())
        return _pick_landmark(rng, scene, tuple(k for k in there if k in fits))
    known = [u for u in scene.units if u.object_type in fits and scene.names[u.object_id] != x.name]
    if known and rng.random() < 0.7:
        return refer(rng, scene, known[int(rng.integers(len(known)))])
    remembered = {base_type(unit.object_type) for unit in scene.units}
    away = [k for k in scene.room.movables if k in fits and k in lexicon() and k not in remembered]
    away = [k for k in away if k != base_type(x.object_type)]
    if not away:
        return None
    return call(rng, scene, pick(rng, away))


def _pick_landmark(rng: Rng, scene: Situation, allowed: tuple[str, ...]) -> Ref | None:
    """Sample a fixture and a name that means no other fixture in the room."""
    allowed = tuple(kind for kind in allowed if kind in lexicon())
    if not allowed:
        return None
    kind = pick(rng, allowed)
    there = scene.room.landmarks if scene.mapped else tuple(lexicon())
    rivals = [k for k in there if k != kind and k in lexicon()]
    if not scene.mapped:  # without a map a shared name means the first of the lexicon
        rivals = rivals[: rivals.index(kind)] if kind in rivals else [
            k for k in lexicon() if list(lexicon()).index(k) < list(lexicon()).index(kind)
        ]  # fmt: skip
    taken = {word for rival in rivals for word in every_word()[rival].words}
    words = tuple(word for word in scene.book.things[kind].names if word not in taken)
    vague = [word for word in vaguely(scene, kind, FITS) if word not in taken]
    if not words or rng.random() < scene.book.vague:
        said = describe(rng, scene, vague)
        if said is None:
            return None
        text = with_article(rng, said.text, "the")
        return Ref(name=kind, object_type=kind, words=text, bare=said.text, plain=False)
    word = pick_common(rng, words)
    text = with_article(rng, word, "the")
    if rng.random() < 0.15:
        text = _decorated(rng, kind, word)
    return Ref(name=kind, object_type=kind, words=text, bare=word)


LOOKS = (
    "white", "black", "brown", "wooden", "big", "small", "left", "right", "other", "nearest",
    "metal", "old", "empty", "tall", "grey", "round",
)  # fmt: skip
WHERE = (
    "over there", "in the corner", "by the wall", "by the window", "next to the door", "there",
    "in this room", "on the left", "on the right", "behind you", "in the middle", "near the wall",
)  # fmt: skip
SWITCHED = (
    "that you switched off", "you turned on", "that is on", "you used", "you switched on before",
    "that you turned off", "you just used", "that is off", "from before",
)  # fmt: skip


def _decorated(rng: Rng, kind: str, word: str) -> str:
    """Add a qualifier to a fixture's name that changes nothing."""
    if "toggleable" in object_types()[kind].capabilities and rng.random() < 0.5:
        return f"{pick(rng, ('the', 'that'))} {word} {pick(rng, SWITCHED)}"
    if rng.random() < 0.5:
        return f"{pick(rng, ('the', 'that', 'one of the'))} {pick(rng, LOOKS)} {word}"
    return f"the {word} {pick(rng, WHERE)}"


def _goal(predicate: str, *arguments: str) -> Goal:
    return Goal(predicate=predicate, arguments=arguments)
