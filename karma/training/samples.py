"""Training examples: a room, a memory and a request, drawn from one seed -> the teacher's program.

No simulator runs here: what is drawn is what an agent would know (area nodes, recalled units, what
is in its hand), rendered by the same `karma.prompt` that plans with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np

from karma.contracts import Area, Goal, MemoryUnit, SkillCall
from karma.prompt import Facts, base_type, compact, landmark_types
from karma.teacher import Thing, View, solve
from karma.training.phrases import Book, lexicon
from karma.world.types import ObjectType, object_types

Rng = np.random.Generator
T = TypeVar("T")
CAPACITY = 10
STATES_BY_CAPABILITY = {
    "dirtyable": (("dirty", 0.15), ("cleaned", 0.3)),
    "canFillWithLiquid": (("filled", 0.15),),
    "openable": (("opened", 0.2), ("closed", 0.2)),
    "toggleable": (("on", 0.15), ("off", 0.15)),
    "canBeUsedUp": (("used up", 0.1),),
}
FOOD_STATES = (("cleaned", 0.35), ("sliced", 0.35), ("heated", 0.08), ("cooked", 0.0))
ENDS_IN = {
    "clean_place": ("Sink",), "heat_place": ("Microwave",), "cook_place": ("Microwave",),
    "cool_place": ("Fridge",),
}  # where the change itself leaves the thing  # fmt: skip
ERRORS = (
    "GoToObject(robot, 'CounterTop'): could not get CounterTop into view and reach",
    "PutObject(robot, 'Mug', 'Sink'): the hand is empty; PickupObject(robot, 'Mug') first",
    "PickupObject(robot, 'Mug'): the hand holds Fork; put it down first",
    "Explore(robot, 'Mug'): could not find Mug; searched 12 places",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """What a request can be about: area nodes and the types of the movable things around."""

    name: str
    areas: tuple[Area, ...]
    movables: tuple[str, ...]

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Return the immovable types worth a word, sorted."""
        return tuple(sorted({k for a in self.areas for k in a.contains} & landmark_types()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """One (memory, instruction) -> program pair, as text."""

    kind: str
    stable: str
    changing: str
    program: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    """One draw: what is known, and what a request may name."""

    room: Room
    facts: Facts  # without the instruction
    names: dict[str, str]  # object id -> short name
    book: Book
    excluded: frozenset[tuple[str, str]]
    mapped: bool  # long-term memory is there

    @property
    def units(self) -> Sequence[MemoryUnit]:
        return self.facts.units


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ask:
    """A request being put together."""

    kind: str
    text: str
    goals: tuple[Goal, ...]


def draw(
    rng: Rng,
    room: Room,
    book: Book,
    *,
    mapped: bool,
    excluded: frozenset[tuple[str, str]] = frozenset(),
) -> Example:
    """Draw one example.

    Args:
        rng: the example's own stream.
        room: where.
        book: phrases of this side of the split.
        mapped: whether long-term memory is in the prompt.
        excluded: (object type, receptacle type) pairs that must not be asked for.
    """
    while True:
        units, held = draw_units(rng, room)
        if held is not None and rng.random() < 0.15:
            units = ()  # without short-term memory the robot still feels what it holds
        facts = Facts(
            instruction="",
            areas=room.areas if mapped else (),
            units=units,
            held_id=held.object_id if held else None,
            held_type=held.object_type if held else None,
        )
        names = {object_id: name for name, object_id in compact(facts).names.items()}
        scene = _Scene(
            room=room, facts=facts, names=names, book=book, excluded=excluded, mapped=mapped
        )
        ask = _draw_ask(rng, scene)
        if ask is None:
            continue
        calls = solve(ask.goals, _view(scene, held))
        if not calls or len(calls) > 30:
            continue
        facts = replace(facts, instruction=ask.text, error=_draw_error(rng, calls))
        prompt = compact(facts).prompt
        program = "".join(f"{call}\n" for call in calls)
        return Example(
            kind=ask.kind, stable=prompt.stable, changing=prompt.changing, program=program
        )


def _draw_error(rng: Rng, calls: Sequence[SkillCall]) -> str:
    """Draw what an earlier program failed on, mostly nothing: often that a place was not known."""
    if rng.random() > 0.12:
        return ""
    lost = [call.objects[0] for call in calls if call.skill == "Explore"]
    shut = [
        (call.objects[0], then.objects[0])
        for call, then in pairwise(calls)
        if call.skill == "OpenObject" and then.skill == "PickupObject"
    ]
    if shut and rng.random() < 0.6:
        place, name = pick(rng, shut)
        place, name = place.partition("_")[0], name.partition("_")[0]
        return (
            f"PickupObject(robot, '{name}'): {name} is in the closed {place}; "
            f"OpenObject(robot, '{place}') first"
        )
    if not lost:
        return pick(rng, ERRORS)
    name = pick(rng, lost)
    skill = pick(rng, ("GoToObject", "PickupObject"))
    return f"{skill}(robot, '{name}'): " + pick(
        rng,
        (
            f"no {name} is known; Explore(robot, '{name}') first",
            f"{name} is not at its remembered place; Explore(robot, '{name}') to find it",
        ),
    )


def _draw_ask(rng: Rng, scene: _Scene) -> _Ask | None:
    """Draw one request, or two in one sentence."""
    first = _one_ask(rng, scene, _pick_kind(rng))
    if first is None:
        return None
    if rng.random() > 0.06:
        return replace(first, text=_wrapped(rng, scene.book, first.text))
    second = _one_ask(rng, scene, _pick_kind(rng))
    if second is None or {g.arguments for g in first.goals} & {g.arguments for g in second.goals}:
        return first
    joint = pick(rng, (" and ", ", then ", " and then ", ", and "))
    return _Ask(kind="two", text=first.text + joint + second.text, goals=first.goals + second.goals)


def pick(rng: Rng, items: Sequence[T]) -> T:
    """Draw one item; `rng.choice` would copy the sequence into an array each time."""
    return items[int(rng.integers(len(items)))]


def _wrapped(rng: Rng, book: Book, text: str) -> str:
    """Add words that mean nothing, before or after."""
    if rng.random() < 0.15:
        text = f"{pick(rng, book.around['before'])} {text}"
    if rng.random() < 0.10:
        text = f"{text} {pick(rng, book.around['after'])}".replace(" ,", ",")
    return text


KINDS = {
    "place": 26, "trash": 5, "clean": 9, "clean_place": 4, "heat": 4, "cook": 4, "heat_place": 3,
    "cook_place": 3, "cool": 3, "cool_place": 3, "slice": 8, "slice_place": 4, "toast": 1.5,
    "fill": 4, "coffee": 2.5, "switch_on": 6, "switch_off": 4, "open": 4, "close": 4, "hold": 15,
    "look": 4, "break": 2, "stack": 4,
}  # fmt: skip


def _pick_kind(rng: Rng) -> str:
    weights = np.array(list(KINDS.values()))
    return tuple(KINDS)[int(np.searchsorted(np.cumsum(weights), rng.random() * weights.sum()))]


# ----------------------------------------------------------------- memory


def draw_units(rng: Rng, room: Room) -> tuple[tuple[MemoryUnit, ...], MemoryUnit | None]:
    """Draw a short-term memory, the last used last, and what is in the hand, if anything."""
    count = 0 if rng.random() < 0.15 else int(1 + CAPACITY * rng.random() ** 1.5)
    pool = [kind for kind in room.movables if kind in lexicon()]
    if not pool:
        return (), None
    units: list[MemoryUnit] = []
    for number in range(count):
        kind = pick(rng, pool)
        if any(base_type(u.object_type) == kind for u in units) and rng.random() < 0.6:
            continue
        late = number / max(count, 1)
        handled = bool(rng.random() < 0.25 + 0.6 * late)
        units.append(_draw_unit(rng, room, kind, number, units, handled=handled))
    held = None
    if units and rng.random() < 0.17:
        held = replace(units[-1], place_id="hand", handled=True)
        units[-1] = held
    return tuple(units), held


def _draw_unit(
    rng: Rng, room: Room, kind: str, number: int, others: Sequence[MemoryUnit], *, handled: bool
) -> MemoryUnit:
    info = object_types()[kind]
    odds = FOOD_STATES if info.slices_into or kind == "Egg" else ()
    for capability, more in STATES_BY_CAPABILITY.items():
        if capability in info.capabilities:
            odds = (*odds, *more)
    states: list[str] = []
    for state, chance in odds:
        chance = 0.2 if state == "cooked" and kind in ("Potato", "Egg", "Bread") else chance
        opposite = {"cleaned": "dirty", "closed": "opened", "off": "on"}.get(state)
        if rng.random() < chance * (1.0 if handled else 0.4) and opposite not in states:
            states.append(state)
    if "sliced" in states and not info.slices_into:
        states.remove("sliced")
    rng.shuffle(states)
    sliced = info.slices_into if "sliced" in states and info.slices_into else kind
    return MemoryUnit(
        object_id=f"{kind}|{number}",
        object_type=sliced,
        position_m=(0.0, 0.0, 0.0),
        states=tuple(states),
        place_id=_draw_place(rng, room, object_types()[sliced], others),
        handled=handled,
    )


def _draw_place(rng: Rng, room: Room, info: ObjectType, others: Sequence[MemoryUnit]) -> str | None:
    fitting = [name for name in room.landmarks if info.fits(object_types()[name])]
    carriers = [
        unit.object_id
        for unit in others
        if unit.place_id != "hand" and info.fits(object_types()[unit.object_type])
    ]
    if carriers and rng.random() < 0.15:
        return pick(rng, carriers)
    if not fitting or rng.random() < 0.04:
        return None
    name = pick(rng, fitting)
    many = name in ("Cabinet", "Drawer", "Shelf", "CounterTop", "SideTable", "StoveBurner")
    return f"{name}|{int(rng.integers(1, 4)) if many else 1}"


def _view(scene: _Scene, held: MemoryUnit | None) -> View:
    """Return the teacher's view of the same knowledge that the prompt states."""
    things = tuple(_thing(scene, unit) for unit in reversed(scene.units))
    return View(
        things=things,
        areas=scene.room.areas if scene.mapped else (),
        held=_thing(scene, held) if held else None,
    )


def _thing(scene: _Scene, unit: MemoryUnit) -> Thing:
    place = unit.place_id if unit.place_id != "hand" else None
    return Thing(
        name=scene.names[unit.object_id],
        object_type=unit.object_type,
        states=unit.states,
        place=scene.names.get(place) if place else None,
        place_type=_place_type(scene.units, place) if place else None,
    )


def _place_type(units: Sequence[MemoryUnit], place: str) -> str:
    return next((u.object_type for u in units if u.object_id == place), place.split("|")[0])


# ----------------------------------------------------------------- what a request is about


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ref:
    """An object that a request names: its program name, type, and the words for it."""

    name: str
    object_type: str
    words: str  # with article, or a pronoun
    bare: str  # without
    plain: bool = True  # the bare name alone means this object


def _one_ask(rng: Rng, scene: _Scene, kind: str) -> _Ask | None:
    """Draw the objects for a kind of request and its sentence; None if the room offers none."""
    if kind in ("switch_on", "switch_off", "open", "close"):
        return _switch_ask(rng, scene, kind)
    x = _draw_ref(rng, scene, kind)
    if x is None:
        return None
    slots = {**_slots("x", x), "x2": "it"}
    goals: list[Goal] = list(_state_goals(kind, x))
    if kind == "look":
        lamp = _pick_landmark(rng, scene, ("DeskLamp", "FloorLamp"))
        if lamp is None:
            return None
        slots |= {**_slots("s", lamp), "s2": "it"}
        goals = [_goal("HOLDON", "robot", x.name), _goal("TOGGLEON", lamp.name)]
    if kind == "trash":
        goals = [_goal("INSIDE", x.name, "GarbageCan")]
        slots["r"] = _with_article(rng, pick(rng, lexicon()["GarbageCan"].names), "the")
    if kind == "place" or kind.endswith("_place") or kind == "stack":
        placed = _placement(rng, scene, kind, x, slots)
        if placed is None:
            return None
        goals += placed
    text = _fill(scene.book.pick(rng, kind), slots)
    return _Ask(kind=kind, text=text, goals=tuple(goals)) if text else None


def _slots(slot: str, ref: "_Ref") -> dict[str, str]:
    """Return the words for one slot; the bare form only where it means the same object."""
    return {slot: ref.words} | ({f"{slot}0": ref.bare} if ref.plain else {})


def _fill(template: str, slots: dict[str, str]) -> str | None:
    """Fill a template; None when it needs words that are not there."""
    try:
        return template.format(**slots)
    except KeyError:
        return None


def _state_goals(kind: str, x: _Ref) -> tuple[Goal, ...]:
    state = {
        "clean": "clean", "heat": "heated", "cook": "cooked", "cool": "cold", "slice": "sliced",
        "toast": "cooked", "fill": "filled", "break": "broken",
    }.get(kind.removesuffix("_place"))  # fmt: skip
    if kind == "hold":
        return (_goal("HOLDON", "robot", x.name),)
    if kind == "coffee":
        return (_goal("STATE", x.name, "filled"), _goal("TOGGLEON", "CoffeeMachine"))
    if kind == "slice_place" and x.object_type.endswith("Sliced"):
        return ()
    return (_goal("STATE", x.name, state),) if state else ()


def _placement(
    rng: Rng, scene: _Scene, kind: str, x: _Ref, slots: dict[str, str]
) -> list[Goal] | None:
    """Draw where to put it; fills the slots; None if nothing fits."""
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


def _switch_ask(rng: Rng, scene: _Scene, kind: str) -> _Ask | None:
    capability = "openable" if kind in ("open", "close") else "toggleable"
    landmarks = tuple(
        name
        for name in (scene.room.landmarks if scene.mapped else sorted(landmark_types()))
        if capability in object_types()[name].capabilities
        or name == "StoveBurner" * (capability == "toggleable")
    )
    movables = [u for u in scene.units if capability in object_types()[u.object_type].capabilities]
    thing: _Ref | None
    if movables and (rng.random() < 0.25 or not landmarks):
        thing = _refer(rng, scene, movables[int(rng.integers(len(movables)))])
    else:
        thing = _pick_landmark(rng, scene, landmarks)
    if thing is None:
        return None
    predicate = {
        "switch_on": "TOGGLEON", "switch_off": "TOGGLEOFF", "open": "OPEN", "close": "CLOSED",
    }[kind]  # fmt: skip
    text = _fill(scene.book.pick(rng, kind), _slots("s", thing))
    return _Ask(kind=kind, text=text, goals=(_goal(predicate, thing.name),)) if text else None


def _draw_ref(rng: Rng, scene: _Scene, kind: str) -> _Ref | None:
    """Draw the object of a request: from memory, from the room, or from anywhere."""
    known = [u for u in scene.units if _suits(kind, u.object_type)]
    if known and rng.random() < 0.65:
        return _refer(rng, scene, known[int(rng.integers(len(known)))])
    remembered = {base_type(unit.object_type) for unit in scene.units}
    remembered.add(base_type(scene.facts.held_type or ""))
    pool = scene.room.movables if rng.random() < 0.85 else tuple(sorted(_movable_types()))
    away = [k for k in pool if k in lexicon() and k not in remembered and _suits(kind, k)]
    if not away:
        return None
    name = pick(rng, away)
    if rng.random() < 0.06 and (guess := _vague_unknown(rng, name, scene)) is not None:
        return guess
    word = pick(rng, lexicon()[name].names)
    return _Ref(name=name, object_type=name, words=_with_article(rng, word), bare=word)


def _vague_unknown(rng: Rng, name: str, scene: _Scene) -> _Ref | None:
    """Name something vaguely that memory does not hold: it means the first type of that kind."""
    if not lexicon()[name].kinds:
        return None
    word = pick(rng, lexicon()[name].kinds)
    if any(word in lexicon()[base_type(u.object_type)].kinds for u in scene.units):
        return None
    first = next(k for k, entry in lexicon().items() if word in entry.kinds)
    return _Ref(name=first, object_type=first, words=f"the {word}", bare=word, plain=False)


@cache
def _movable_types() -> frozenset[str]:
    return frozenset(
        name
        for name, kind in object_types().items()
        if "pickupable" in kind.capabilities and name in lexicon()
    )


def _suits(kind: str, object_type: str) -> bool:
    """Return whether a kind of request makes sense for a type."""
    info = object_types()[object_type]
    base = base_type(object_type)
    sort = kind.removesuffix("_place")
    if sort == "slice":
        return bool(info.slices_into) or (kind == "slice_place" and object_type != base)
    checks = {
        "clean": _fits(info, "Sink"), "heat": _fits(info, "Microwave"),
        "cook": base == "Potato" or object_type == "Egg", "cool": _fits(info, "Fridge"),
        "toast": base == "Bread", "fill": "canFillWithLiquid" in info.capabilities
        and _fits(info, "Sink"), "coffee": base == "Mug", "break": "breakable" in info.capabilities,
        "trash": _fits(info, "GarbageCan"),
    }  # fmt: skip
    return checks.get(sort, True)


def _fits(info: ObjectType, place: str) -> bool:
    kinds = object_types()
    return info.fits(kinds[place]) or (place == "Sink" and info.fits(kinds["SinkBasin"]))


def _draw_receptacle(rng: Rng, scene: _Scene, x: _Ref, *, movable: bool) -> _Ref | None:
    """Draw what a thing is put into: a landmark, or a dish from memory or the room."""
    info = object_types()[x.object_type]
    kinds = object_types()
    fits = [
        k for k in kinds if _fits(info, k) and (base_type(x.object_type), k) not in scene.excluded
    ]
    if not movable:
        there = scene.room.landmarks if scene.mapped else sorted(landmark_types())
        return _pick_landmark(rng, scene, tuple(k for k in there if k in fits))
    known = [u for u in scene.units if u.object_type in fits and scene.names[u.object_id] != x.name]
    if known and rng.random() < 0.7:
        return _refer(rng, scene, known[int(rng.integers(len(known)))])
    remembered = {base_type(unit.object_type) for unit in scene.units}
    away = [k for k in scene.room.movables if k in fits and k in lexicon() and k not in remembered]
    away = [k for k in away if k != base_type(x.object_type)]
    if not away:
        return None
    name = pick(rng, away)
    word = pick(rng, lexicon()[name].names)
    return _Ref(name=name, object_type=name, words=_with_article(rng, word), bare=word)


def _pick_landmark(rng: Rng, scene: _Scene, allowed: tuple[str, ...]) -> _Ref | None:
    """Pick an immovable thing and a name that means no other one in the room."""
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
    taken = {word for rival in rivals for word in lexicon()[rival].names}
    words = [word for word in lexicon()[kind].names if word not in taken]
    if not words:
        return None
    word = pick(rng, words)
    return _Ref(name=kind, object_type=kind, words=_with_article(rng, word, "the"), bare=word)


# ----------------------------------------------------------------- words for a remembered unit


def _refer(rng: Rng, scene: _Scene, unit: MemoryUnit) -> _Ref | None:
    """Draw words that mean this unit and no other; None after a few tries."""
    name = scene.names[unit.object_id]
    entry = lexicon()[base_type(unit.object_type)]
    for _ in range(4):
        roll = rng.random()
        bare = pick(rng, entry.names)
        if roll < 0.55:
            said = _adjective(rng, scene, unit, 0.3)
            words, meant = f"{said[0]} {bare}".strip(), _meant(scene, unit, said[1], exact=True)
            text = _with_article(rng, words)
        elif roll < 0.80 and entry.kinds:
            kind = pick(rng, entry.kinds)
            said = _adjective(rng, scene, unit, 0.6)
            meant = _meant(scene, unit, said[1], kind=kind)
            text = f"the {said[0]} {kind}".replace("  ", " ")
        elif roll < 0.88:
            text, meant = pick(rng, ("it", "it", "that", "this")), _last_handled(scene)
        elif roll < 0.94:
            text, meant = _just(rng, scene, unit)
        else:
            text, meant = _placed_words(rng, scene, unit)
        if "sliced" in unit.states and rng.random() < 0.3:
            text = f"{pick(rng, ('a slice of', 'a piece of', 'some of', 'one slice of'))} {text}"
        if meant is not None and meant.object_id == unit.object_id:
            plain = _meant(scene, unit, "", exact=True) is unit
            return _Ref(name=name, object_type=unit.object_type, words=text, bare=bare, plain=plain)
    return None


def _adjective(rng: Rng, scene: _Scene, unit: MemoryUnit, chance: float) -> tuple[str, str]:
    """Return (word, state) for one of the unit's states, or two empty strings."""
    states = [s for s in unit.states if scene.book.adjectives.get(s.replace(" ", "_"))]
    if not states or rng.random() > chance:
        return "", ""
    state = pick(rng, states)
    return pick(rng, scene.book.adjectives[state.replace(" ", "_")]), state


def _meant(
    scene: _Scene, unit: MemoryUnit, state: str, *, exact: bool = False, kind: str = ""
) -> MemoryUnit | None:
    """Return which unit such words mean: the last handled one that fits, else the last one."""

    def fits(other: MemoryUnit) -> bool:
        base = base_type(other.object_type)
        named = base == base_type(unit.object_type) if exact else kind in lexicon()[base].kinds
        return named and (not state or state in other.states)

    fitting = [other for other in scene.units if fits(other)]
    handled = [other for other in fitting if other.handled]
    chosen = handled or fitting
    return chosen[-1] if chosen else None


def _last_handled(scene: _Scene) -> MemoryUnit | None:
    return next((unit for unit in reversed(scene.units) if unit.handled), None)


def _just(rng: Rng, scene: _Scene, unit: MemoryUnit) -> tuple[str, MemoryUnit | None]:
    """Return words such as `the thing you just washed`, and the unit they mean."""
    options = [s for s in unit.states if s in scene.book.just]
    state = pick(rng, (*options, "moved"))
    noun = pick(rng, ("thing", "one", "item", "object"))
    words = f"the {noun} {pick(rng, scene.book.just[state])}"
    if state == "moved":
        return words, _last_handled(scene)
    fitting = [u for u in scene.units if state in u.states]
    handled = [u for u in fitting if u.handled]
    return words, (handled or fitting)[-1]


def _placed_words(rng: Rng, scene: _Scene, unit: MemoryUnit) -> tuple[str, MemoryUnit | None]:
    """Return words that name a unit by where it is or by what is in it, and what they mean."""
    cargo = [other for other in scene.units if other.place_id == unit.object_id]
    if cargo:
        inside = pick(rng, lexicon()[base_type(cargo[-1].object_type)].names)
        noun = pick(rng, (*lexicon()[base_type(unit.object_type)].names, "container", "dish"))
        return f"the {noun} with the {inside}", unit
    if unit.place_id is None or unit.place_id == "hand":
        return "", None
    place = _place_type(scene.units, unit.place_id)
    if base_type(place) not in lexicon():
        return "", None
    there = [u for u in scene.units if u.place_id and _place_type(scene.units, u.place_id) == place]
    handled = [other for other in there if other.handled] or there
    entry = lexicon()[base_type(unit.object_type)]
    noun = pick(rng, ("thing", "object", "item", *entry.names, *entry.kinds))
    if noun in (*entry.names, *entry.kinds):
        fitting = [
            u
            for u in there
            if noun in lexicon()[base_type(u.object_type)].names
            or noun in lexicon()[base_type(u.object_type)].kinds
        ]
        handled = [other for other in fitting if other.handled] or fitting
    where = pick(rng, lexicon()[base_type(place)].names)
    words = pick(
        rng,
        (
            "the {n} in the {w}",
            "the {n} on the {w}",
            "the {n} from the {w}",
            "what you put in the {w}",
            "what is on the {w}",
            "what you left on the {w}",
        ),
    )
    if "{n}" not in words:
        handled = [other for other in there if other.handled] or there
    return words.format(n=noun, w=where), handled[-1]


def _with_article(rng: Rng, words: str, article: str = "") -> str:
    if not article:
        article = pick(rng, ("the", "the", "the", "the", "a", "a", "my", "that", "one of the", ""))
    if article == "one of the":
        words += "s"
    if article == "a" and words[0] in "aeiou":
        article = "an"
    return f"{article} {words}".strip()


def _goal(predicate: str, *arguments: str) -> Goal:
    return Goal(predicate=predicate, arguments=arguments)
