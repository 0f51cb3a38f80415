"""Several requests in one sentence: in turn, one deed for several things, several deeds for one.

Each later clause is drawn in the situation that the ones before it leave behind.
"""

from collections.abc import Sequence
from dataclasses import replace

from karma.contracts import Goal
from karma.household import uses
from karma.household.containment import goes_in
from karma.household.ids import short_type
from karma.household.places import HAND
from karma.household.types import object_types
from karma.plugins.training.drawing.memories import Rng, after, pick, unit_of, weighted
from karma.plugins.training.drawing.referring_expressions import Situation
from karma.plugins.training.drawing.requests import KINDS, Ask, filled, one_ask, pick_kind, suits

SEVERAL = "several"
FORMS = {"in turn": 4, "one thing": 3, "shared deed": 3, "close it": 0.7, "listed deeds": 1}
CHANGES = ("clean", "slice", "heat", "cook", "cool", "fill")  # of a thing that stays at hand
LAST = {"place": 5, "trash": 1, "hold": 1.5}  # what can be asked of a thing after them
SWITCHES = ("switch_on", "switch_off", "open", "close")
PRONOUNS = frozenset({"it", "that", "this", "that one", "this thing"})
OWN_KINDS = {kind: odds for kind, odds in KINDS.items() if not kind.endswith("_place")}
APPLIANCES = frozenset({
    *uses.with_basin(uses.SINK), *uses.TAPS, uses.MICROWAVE, uses.FRIDGE, uses.TOASTER,
    uses.COFFEE_MACHINE, uses.BIN,
})  # fmt: skip
TRIES = 8


def several_asks(rng: Rng, scene: Situation) -> Ask | None:
    """Draw two or three requests and the sentence that asks for them; None if none was found."""
    draw = {
        "in turn": _in_turn, "one thing": _about_one, "shared deed": _shared_deed,
        "close it": _closed_after, "listed deeds": _listed,
    }[weighted(rng, FORMS)]  # fmt: skip
    tries = (*(draw,) * TRIES, *(_in_turn,) * TRIES)
    return next(filter(None, (one(rng, scene) for one in tries)), None)


def later(scene: Situation, goals: Sequence[Goal]) -> Situation:
    """Return the situation once goals are met: what was handled comes last, where it now is."""
    units, names = list(scene.units), dict(scene.names)
    id_of = {name: object_id for object_id, name in names.items()}
    for goal in goals:
        name = _thing(goal)
        kind = object_types().get(short_type(name))
        if kind is None or "pickupable" not in kind.capabilities or goal.count > 1:
            continue
        object_id = id_of.setdefault(name, name)
        names[object_id] = name
        unit = next((one for one in units if one.object_id == object_id), None) or unit_of(
            object_id, kind.name
        )
        changed = after(unit, goal)
        place = changed.place_id
        if goal.predicate in ("ON", "INSIDE"):
            place = id_of.get(goal.arguments[1], goal.arguments[1])
        elif place == HAND:
            units = [replace(u, place_id=None) if u.place_id == HAND else u for u in units]
        units = [one for one in units if one.object_id != object_id]
        units.append(replace(changed, place_id=place, handled=True))
    facts = replace(scene.facts, units=tuple(units))
    return replace(scene, facts=facts, names=names)


# ----------------------------------------------------------------- in turn


def _in_turn(rng: Rng, scene: Situation) -> Ask | None:
    """Ask for two or three things that have nothing to do with each other."""
    asks: list[Ask] = []
    now = scene
    count = 3 if rng.random() < 0.3 else 2
    for number in range(count):
        kind = pick_kind(rng, OWN_KINDS if number + 1 < count else KINDS)
        ask = one_ask(rng, now, kind)
        if ask is None or (asks and ask.slots.get("x") in PRONOUNS) or _clash(asks, ask):
            return None
        asks.append(ask)
        now = later(now, ask.goals)
    return _sentence(rng, scene, asks)


def _clash(asks: Sequence[Ask], ask: Ask) -> bool:
    """Return whether a request undoes or repeats one of some others, or needs a second hand."""
    if asks and asks[-1].kind in ("hold", "look") and ask.kind not in SWITCHES:
        return True
    if any(one.kind in ("hold", "look") for one in asks[:-1]):
        return True
    mine = _things_of(ask)
    return any(mine & _things_of(other) - _shared_places(ask, other) for other in asks)


def _things_of(ask: Ask) -> set[str]:
    """Return what a request has to do with, its appliances and knife included."""
    names = {word for goal in ask.goals for word in goal.arguments if goal.predicate != "STATE"}
    names |= {goal.arguments[0] for goal in ask.goals if goal.predicate == "STATE"}
    if ask.kind in SWITCHES:
        return names
    if ask.kind.startswith("slice"):
        names.add(uses.KNIFE)
    needs = ask.kind.startswith(("clean", "fill", "heat", "cook", "cool", "toast", "coffee"))
    return (names | APPLIANCES if needs else names) - {"robot"}


def _shared_places(ask: Ask, other: Ask) -> set[str]:
    """Return what two requests may both have to do with."""
    if ask.kind in SWITCHES or other.kind in SWITCHES:
        return set()
    knives = (
        {uses.KNIFE} if ask.kind.startswith("slice") and other.kind.startswith("slice") else set()
    )
    return {*APPLIANCES, *_places(ask), *knives} & (_places(other) | APPLIANCES | knives)


def _places(ask: Ask) -> set[str]:
    """Return where a request puts things."""
    return {goal.arguments[1] for goal in ask.goals if goal.predicate in ("ON", "INSIDE")}


# ----------------------------------------------------------------- one thing


def _about_one(rng: Rng, scene: Situation) -> Ask | None:
    """Ask for two or three deeds with one thing: "wash the apple and put it in the fridge"."""
    kinds = _deeds(rng)
    first = one_ask(rng, scene, kinds[0])
    if first is None:
        return None
    asks, now, goals = [first], later(scene, first.goals), list(first.goals)
    for kind in kinds[1:]:
        ask = one_ask(rng, replace(now, about=now.units[-1]), kind)
        if ask is None or (kind == "slice" and "sliced" in now.units[-1].states):
            return None
        asks.append(ask)
        now = later(now, ask.goals)
        goals += ask.goals
    if kinds[0] == "hold":
        goals = goals[1:]  # it is in the hand on the way only
    return _sentence(rng, scene, asks, (tuple(dict.fromkeys(goals)),))


def _deeds(rng: Rng) -> list[str]:
    """Draw what is to be done with a thing, in turn."""
    changes = [CHANGES[int(n)] for n in rng.permutation(len(CHANGES))]
    hot = [kind for kind in changes if kind in ("heat", "cook", "cool")][:1]
    changes = [kind for kind in changes if kind in ("clean", "slice", "fill") or kind in hot]
    changes = changes[: int(rng.integers(1, 3))]
    if rng.random() < 0.25:
        changes.insert(0, "hold")
    if len(changes) == 1 or rng.random() < 0.5:
        changes.append(weighted(rng, LAST))
    return changes[:3]


def _listed(rng: Rng, scene: Situation) -> Ask | None:
    """Ask with a list of verbs before one thing: "wash, slice and heat the tomato"."""
    kinds = [kind for kind in _deeds(rng) if kind in scene.book.deeds]
    kinds = [kind for kind in kinds[:-1] if kind not in ("hold", "trash")] + kinds[-1:]
    first = one_ask(rng, scene, kinds[0]) if len(kinds) > 1 else None
    if first is None or kinds[-1] == "hold":
        return None
    now = later(scene, first.goals)
    goals = list(first.goals)
    for kind in kinds[1:]:
        about = now.units[-1]
        ask = (
            one_ask(rng, replace(now, about=about), kind)
            if suits(kind, about.object_type)
            else None
        )
        if ask is None:
            return None
        goals += ask.goals
        now = later(now, ask.goals)
    verbs = [pick(rng, scene.book.deeds[kind]) for kind in kinds]
    text = f"{_listing(rng, scene, verbs)} {first.slots['x']}"
    goals = list(dict.fromkeys(goals))
    return Ask(kind=SEVERAL, text=text, goals=tuple(goals), parts=(tuple(goals),))


# ----------------------------------------------------------------- one deed


def _shared_deed(rng: Rng, scene: Situation) -> Ask | None:
    """Ask for the same to be done with two or three things: "wash the fork and the knife"."""
    kind = pick_kind(rng, {k: odds for k, odds in KINDS.items() if k in scene.book.shared})
    asks: list[Ask] = []
    count = 3 if rng.random() < 0.25 else 2
    for _ in range(count * TRIES):
        ask = one_ask(rng, scene, kind)
        ask = _moved(scene, ask, asks[0]) if ask is not None and asks else ask
        if ask is not None and not _same_thing(asks, ask):
            asks.append(ask)
        if len(asks) == count:
            break
    slot = "s" if kind in SWITCHES else "x"
    words = [ask.slots[slot] for ask in asks]
    if len(asks) < count or not PRONOUNS.isdisjoint(words):
        return None
    slots = {**asks[0].slots, slot: _listing(rng, scene, words)}
    text = filled(scene.book.say(rng, scene.book.shared[kind]), slots)
    return _joint(text, [ask.goals for ask in asks]) if text else None


def _moved(scene: Situation, ask: Ask, first: Ask) -> Ask | None:
    """Return a request with the place of another one; None where the thing does not go there."""
    if ask.kind != "place":
        return ask
    place = first.goals[-1].arguments[1]
    thing = ask.goals[-1].arguments[0]
    if thing == place or not goes_in(short_type(thing), short_type(place)):
        return None
    return replace(ask, goals=(replace(ask.goals[-1], arguments=(thing, place)),))


def _same_thing(asks: Sequence[Ask], ask: Ask) -> bool:
    things = {_thing(goal) for one in asks for goal in one.goals}
    return any(_thing(goal) in things or goal.arguments[-1] in things for goal in ask.goals)


# ----------------------------------------------------------------- what it was put in


def _closed_after(rng: Rng, scene: Situation) -> Ask | None:
    """Ask to put something into what is opened before or closed after: "open it, ... close it"."""
    ask = one_ask(rng, scene, "place")
    place = ask.goals[-1].arguments[1] if ask else ""
    info = object_types().get(place)
    if ask is None or info is None or "openable" not in info.capabilities:
        return None
    if rng.random() < 0.5:
        said = pick(rng, ("close it", "shut it", "close it again", f"close {ask.slots['r']}"))
        return _sentence(rng, scene, [ask, replace(ask, text=said)], (ask.goals,))
    there = pick(rng, ("in it", "inside", "in there", "into it"))
    thing = ask.slots["x"]
    if thing in PRONOUNS:
        return None
    verb = pick(rng, ("put", "place", "leave", "set"))
    steps = [f"open {ask.slots['r']}", f"{verb} {thing} {there}"]
    asks = [replace(ask, text=text) for text in steps]
    if rng.random() < 0.5:
        asks.append(replace(ask, text=pick(rng, ("close it", "shut it", "close it again"))))
    return _sentence(rng, scene, asks, (ask.goals,))


# ----------------------------------------------------------------- sentences


def _sentence(
    rng: Rng,
    scene: Situation,
    asks: Sequence[Ask],
    parts: Sequence[tuple[Goal, ...]] = (),
) -> Ask:
    """Join requests; their goals come true one after the other, or as `parts` says."""
    pattern = scene.book.say(rng, scene.book.joined["two" if len(asks) == 2 else "three"])
    texts = dict(zip("abc", (ask.text for ask in asks), strict=False))
    return _joint(pattern.format(**texts), parts or [ask.goals for ask in asks])


def _listing(rng: Rng, scene: Situation, words: Sequence[str]) -> str:
    pattern = scene.book.say(rng, scene.book.joined["things" if len(words) == 2 else "more_things"])
    return pattern.format(**dict(zip("abc", words, strict=False)))


def _joint(text: str, parts: Sequence[tuple[Goal, ...]]) -> Ask:
    goals = tuple(dict.fromkeys(goal for part in parts for goal in part))
    return Ask(kind=SEVERAL, text=text, goals=goals, parts=tuple(parts))


def _thing(goal: Goal) -> str:
    return goal.arguments[1] if goal.predicate == "HOLDON" else goal.arguments[0]
