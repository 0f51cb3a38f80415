"""The expert's programs: goals and what is known -> skill calls.

The nano planner learns from them, and the method `expert` (`karma.bench.methods.expert`) acts on
them. It knows the skill API and household facts, not the world: its view may be one agent's memory
or the whole truth, and holds what the world refused, so that the next program differs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from karma.agent.planning.inspector import likely_areas
from karma.household import uses
from karma.household.containment import brings, fits_whole_or_cut, goes_in
from karma.household.ids import is_position
from karma.household.pieces import EGG, base_type, is_piece
from karma.household.places import FLOOR, HAND, LIKELY, STAND_CLOSED, SURFACES
from karma.household.skill_effects import SIDE_EFFECTS, BeliefState, Item, apply
from karma.household.states import END_STATES, deed_for
from karma.household.types import object_types
from karma.types.memory import Area
from karma.types.planning import SkillCall
from karma.types.tasks import Goal

_Errand = tuple[str, list[Goal]]  # a subject and the goals about it
_PLACED = ("ON", "INSIDE")
_PLACES = tuple(dict.fromkeys((*SURFACES, *LIKELY, FLOOR)))  # to put something down
_PREDICATES = {state: predicate for predicate, state in END_STATES.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedThing:
    """One object as a program may name it."""

    name: str
    object_type: str
    states: tuple[str, ...] = ()
    place: str | None = None  # name of the receptacle it is in or on
    place_type: str | None = None
    holds: bool = True  # False: it takes nothing, so things are put near it
    contents: tuple[str, ...] = ()  # names of what can be carried and lies in or on it
    now: tuple[str, ...] = ()  # true states of the moment, where they are known


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpertView:
    """What is known when the program is written, and what was learned when one was refused."""

    things: tuple[NamedThing, ...] = ()  # the last used first
    areas: tuple[Area, ...] = ()
    landmarks: frozenset[str] = frozenset()  # types of immovable things, beside those of the areas
    held: NamedThing | None = None
    refused: frozenset[tuple[str, str]] = frozenset()  # a thing, and a receptacle that took it not
    shunned: frozenset[str] = frozenset()  # names of what is not to be used: out of reach, hidden
    in_the_way: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # what to move first
    awkward: frozenset[str] = frozenset()  # names of what cannot be cut where it lies


@dataclass(slots=True)
class _Draft:
    """A program being written, and what is believed after its last call."""

    view: ExpertView
    beliefs: BeliefState
    calls: list[SkillCall] = field(default_factory=list)
    taken: dict[str, NamedThing] = field(default_factory=dict)
    found: set[str] = field(default_factory=set)
    freed: set[str] = field(default_factory=set)

    @property
    def held(self) -> NamedThing | None:
        """What is in the hand."""
        held = self.beliefs.held
        return self.taken.get(held.name, self.view.held) if held is not None else None

    def say(self, skill: str, *objects: str, positions: tuple[str, ...] = ()) -> None:
        """Append one call, leaving out a walk to where the robot already is."""
        call = SkillCall(skill=skill, objects=objects, positions=positions)
        if not (skill == "GoToObject" and self.calls and self.calls[-1] == call):
            self.calls.append(call)
            self.beliefs = apply(call, self.beliefs)

    def moved_to(self, name: str) -> str | None:
        """Return the receptacle that the program puts a thing into, None for no such."""
        place = self.beliefs.places.get(Item(name))
        return None if place is None or place.beside or place.name == HAND else place.name

    def thing(self, word: str) -> NamedThing:
        """Return what a goal's word means: what is held, a known thing, or just a type."""
        known = [*([self.held] if self.held else []), *self.view.things]
        for candidate in known:
            if word == candidate.name:
                return candidate
        usable = [one for one in known if one.name not in self.view.shunned]
        for whole in (base_type, uses.without_basin):
            if found := next((one for one in usable if word == whole(one.object_type)), None):
                return found
        return NamedThing(name=word, object_type=word)

    def holder_of(self, thing: NamedThing) -> NamedThing | None:
        """Return the receptacle that holds a thing, the outer of two, None if it is unknown."""
        if (place := self.moved_to(thing.name)) is not None:
            holder = self.thing(place)
            return self.holder_of(holder) or replace(holder, name=place)
        if thing.place is None or thing.place_type is None:
            return None
        return replace(self.thing(thing.place), name=thing.place, object_type=thing.place_type)

    def has_landmark(self, kind: str) -> bool:
        """Return whether long-term memory knows an immovable thing of this type."""
        view = self.view
        return kind in view.landmarks or any(kind in area.contains for area in view.areas)

    def knows(self, thing: NamedThing) -> bool:
        """Return whether the robot can go straight there."""
        names = {*self.found, *(known.name for known in self.view.things)}
        return thing.name in names or self.has_landmark(thing.object_type)

    def reach(self, thing: NamedThing) -> str | None:
        """Write the way to a thing; return the container that had to be opened for it."""
        if self.held is not None and thing.name == self.held.name:
            return None
        place = self.holder_of(thing)
        if place is not None and _is_shut(place):
            self.say("GoToObject", place.name)
            self.open(place)
            return place.name
        if not self.knows(thing):
            areas = likely_areas(thing.object_type, self.view.areas)
            self.say("Explore", thing.name, positions=areas)
            self.found.add(thing.name)
        self.say("GoToObject", thing.name)
        return None

    def do_at(self, thing: NamedThing, skill: str, *objects: str) -> None:
        """Write the way to a thing and what is done there, and shut what was opened for it."""
        opened = self.reach(thing)
        self.say(skill, *objects)
        if opened is not None:
            self.say("CloseObject", opened)

    def run(self, appliance: str) -> None:
        """Write the lines that let an appliance run for a moment."""
        self.say("ToggleOn", appliance)
        self.say("ToggleOff", appliance)

    def open(self, place: NamedThing) -> None:
        """Write the lines that open a receptacle where the robot stands before it."""
        if "on" in place.now:
            self.say("ToggleOff", place.name)
        self.say("OpenObject", place.name)

    def free(self, name: str) -> None:
        """Write the lines that put elsewhere what is in the way of a thing."""
        if name not in self.freed:
            self.freed.add(name)
            for other in self.view.in_the_way.get(name, ()):
                self.take(self.thing(other))
                self.put_down()

    def take(self, thing: NamedThing) -> None:
        """Write the lines that take a thing into the hand."""
        if self.held is not None and thing.name == self.held.name:
            return
        self.free(thing.name)
        if self.held is not None:
            self.put_down()
        self.taken[thing.name] = thing
        self.do_at(thing, "PickupObject", thing.name)

    def put_down(self) -> None:
        """Write the lines that put what is held on the best known surface."""
        assert self.held is not None
        kind = self.held.object_type
        fits = [one for one in _PLACES if kind not in object_types() or goes_in(kind, one)]
        allowed = [name for name in SURFACES if name in fits] or list(SURFACES)
        others = [name for name in fits if name not in allowed]
        known = [name for name in (*allowed, *others) if self.has_landmark(name)]
        surfaces = [one for name in known for one in self._surfaces(self.held, name)]
        first = NamedThing(name=allowed[0], object_type=allowed[0])
        self.put(self.held, next(iter(surfaces), first))

    def _surfaces(self, thing: NamedThing, kind: str) -> Iterator[NamedThing]:
        """Yield a type to put a thing on; once that was refused, those of it that were not."""
        ones = [one for one in self.view.things if one.object_type == kind]
        names = {one.name for one in ones}
        bad = {place for held, place in self.view.refused if held == thing.name} | self.view.shunned
        if bad.isdisjoint((kind, *names)):
            yield NamedThing(name=kind, object_type=kind)
        else:
            yield from (one for one in ones if one.name not in bad and one.holds)

    def put(self, thing: NamedThing, receptacle: NamedThing, *, close: bool = True) -> None:
        """Write the lines that put a thing into a receptacle, opening and closing what must be."""
        if not receptacle.holds:
            self.take(thing)
            if is_position(receptacle.name):
                self.say("PutNear", thing.name, receptacle.name)
            else:
                self.do_at(receptacle, "PutNear", thing.name, receptacle.name)
            return
        self.free(receptacle.name)
        self.take(thing)
        opened = self.reach(receptacle)
        if _is_shut(receptacle):
            self.open(receptacle)
            opened = receptacle.name
        self.say("PutObject", thing.name, receptacle.name)
        if opened is not None and close:
            self.say("CloseObject", opened)
        self.found.add(thing.name)


def _is_shut(place: NamedThing) -> bool:
    """Return whether a receptacle has to be opened: those that stand closed are, to be sure."""
    return place.object_type in STAND_CLOSED or "closed" in place.now


def solve(goals: Sequence[Goal], view: ExpertView) -> tuple[SkillCall, ...]:
    """Write the program that makes the goals true, one subject after another; () for nothing to do.

    They come true in their order; arguments are names of `view.things` or AI2-THOR types.
    """
    draft = _Draft(view, BeliefState.holding(view.held.name if view.held is not None else None))
    for subject, mine in _in_order(list(_by_subject(goals))):
        _satisfy(draft, subject, mine)
    return tuple(draft.calls)


def _by_subject(goals: Sequence[Goal]) -> Iterator[_Errand]:
    """Yield what each goal is about, with all goals about it and those that only help with them."""
    rest = list(goals)
    while rest:
        subject = _subject(rest[0])
        mine = [goal for goal in rest if _subject(goal) == subject]
        mine += [goal for goal in rest if goal not in mine and _helps(goal, mine)]
        yield subject, mine
        rest = [goal for goal in rest if goal not in mine]


def _in_order(errands: Sequence[_Errand]) -> list[_Errand]:
    """Return errands so that none undoes another.

    A dish is filled before it goes to its place, and what is to be held at the end is taken last,
    unless the hand is not needed any more.
    """
    filled = {g.arguments[1] for _, mine in errands for g in mine if g.predicate in _PLACED}
    first: list[_Errand] = []
    placed: list[_Errand] = []
    held: list[_Errand] = []
    for subject, mine in errands:
        holding = [goal for goal in mine if goal.predicate == "HOLDON"]
        placing = [goal for goal in mine if goal.predicate in _PLACED and subject in filled]
        rest = [goal for goal in mine if goal not in holding and goal not in placing]
        for kind, goals in ((first, rest), (placed, placing), (held, holding)):
            if goals:
                kind.append((subject, goals))
    busy = any(goal.predicate in (*_PLACED, "STATE") for _, mine in first for goal in mine)
    return [*first, *placed, *held] if busy or placed else list(errands)


def _subject(goal: Goal) -> str:
    return goal.arguments[1] if goal.predicate == "HOLDON" else goal.arguments[0]


def _wants(goals: Sequence[Goal], state: str) -> bool:
    return any(g.predicate == "STATE" and deed_for(g.arguments[1]) == state for g in goals)


def _helps(goal: Goal, mine: Sequence[Goal]) -> bool:
    """Return whether an appliance is switched on only to change the subject of other goals."""
    kind = {uses.KNOB: uses.BURNER}.get(goal.arguments[0], goal.arguments[0])  # a type, no id
    brought = (one.adds[0] for one in SIDE_EFFECTS if one.state == "on" and kind in one.of)
    return goal.predicate == "TOGGLEON" and any(_wants(mine, state) for state in brought)


def _satisfy(draft: _Draft, subject: str, goals: Sequence[Goal]) -> None:
    """Write the lines for all goals about one object: change it, then place it."""
    thing = draft.thing(subject)
    placed = [g for g in goals if g.predicate in _PLACED]
    done_in = ""
    for goal in goals:
        if goal.predicate == "STATE":
            state = deed_for(goal.arguments[1]) or ""
            done_in = _change(draft, thing, state, goals) or done_in
        elif goal not in placed and goal.predicate != "HOLDON" and not _helps(goal, goals):
            _switch(draft, goal)
    for goal in placed:
        if uses.without_basin(draft.thing(goal.arguments[1]).object_type) != done_in:
            _place(draft, thing, draft.thing(goal.arguments[1]))
    if any(goal.predicate == "HOLDON" for goal in goals):
        draft.take(thing)


def _place(draft: _Draft, thing: NamedThing, place: NamedThing) -> None:
    """Write the lines that bring a thing to its place: whole, or cut first, or in a vessel."""
    what, where = thing.object_type, place.object_type
    if place.holds and {what, where} <= object_types().keys() and not goes_in(what, where):
        if fits_whole_or_cut(what, where):
            _slice(draft, thing)
            return  # the next program has the pieces
        vessels = (
            one
            for one in draft.view.things
            if brings(one.object_type, what, where)
            and thing.name not in (one.name, draft.moved_to(one.name))
        )  # not one that lies in the thing
        if (vessel := next(vessels, None)) is not None:
            draft.put(thing, vessel)
            thing = vessel
    draft.put(thing, place)


def _change(draft: _Draft, thing: NamedThing, state: str, goals: Sequence[Goal]) -> str:
    """Write the lines for one STATE goal; return the type of the place it ends in, if any."""
    if state == "sliced":
        _slice(draft, thing)
    elif state == "cleaned":
        return _rinse(draft, thing)
    elif state == "filled":
        coffee = any(uses.COFFEE_MACHINE in g.arguments for g in goals)
        return _coffee(draft, thing) if coffee else _rinse(draft, thing)
    elif state in ("cooked", "heated"):
        return _heat(draft, thing, state)
    elif state == "cooled":
        draft.put(thing, draft.thing(uses.FRIDGE))
        return uses.FRIDGE
    elif state == "empty":
        _empty(draft, thing)
    elif state == "broken":
        if draft.held is not None and draft.held.name == thing.name:
            draft.put_down()
        draft.reach(thing)
        draft.say("BreakObject", thing.name)
    elif (predicate := _PREDICATES.get(state)) is not None:
        _switch(draft, Goal(predicate=predicate, arguments=(thing.name,)))
    return ""


def _slice(draft: _Draft, thing: NamedThing) -> None:
    """Write the lines that fetch a knife, as Listing 2 does, and slice."""
    if thing.name in draft.view.awkward:
        draft.take(thing)
        draft.put_down()
    if draft.held is None or draft.held.object_type not in uses.KNIVES:
        knives = [draft.thing(kind) for kind in uses.KNIVES]
        draft.take(next((knife for knife in knives if draft.knows(knife)), knives[0]))
    draft.do_at(thing, "SliceObject", thing.name)


def _empty(draft: _Draft, thing: NamedThing) -> None:
    """Write the lines that take everything out of a thing and pour out what it is filled with."""
    for name in thing.contents:
        draft.take(draft.thing(name))
        draft.put_down()
    kind = object_types().get(thing.object_type)
    vessel = kind is not None and kind.can("canFillWithLiquid")
    if vessel and (not thing.now or "filled" in thing.now):
        draft.do_at(thing, "EmptyObject", thing.name)


def _rinse(draft: _Draft, thing: NamedThing) -> str:
    """Write the lines that rinse a thing, which cleans it, and fills it if it can be filled."""
    draft.put(thing, draft.thing(uses.SINK))
    draft.run(uses.FAUCET)
    return uses.SINK


def _coffee(draft: _Draft, thing: NamedThing) -> str:
    draft.put(thing, draft.thing(uses.COFFEE_MACHINE))
    draft.say("ToggleOn", uses.COFFEE_MACHINE)
    return uses.COFFEE_MACHINE


def _heat(draft: _Draft, thing: NamedThing, state: str) -> str:
    """Write the lines that toast bread, or heat anything else, an egg cracked, in a microwave."""
    if base_type(thing.object_type) == uses.TOASTED and state == "cooked":
        if "sliced" not in thing.states and not is_piece(thing.object_type):
            _slice(draft, thing)
        draft.put(thing, draft.thing(uses.TOASTER))
        draft.run(uses.TOASTER)
        return uses.TOASTER
    oven = draft.thing(uses.MICROWAVE)
    draft.put(thing, oven, close=False)
    if thing.object_type == EGG and state == "cooked":
        draft.say("BreakObject", thing.name)
    draft.say("CloseObject", oven.name)
    draft.run(oven.name)
    return uses.MICROWAVE


def _switch(draft: _Draft, goal: Goal) -> None:
    """Write the lines that switch or open a thing; what is in the hand stays there."""
    thing = draft.thing(goal.arguments[0])
    verb = {"OPEN": "OpenObject", "CLOSED": "CloseObject"}.get(goal.predicate)
    if verb is None:
        kind = "Switch" if thing.object_type == "LightSwitch" else "Toggle"
        verb = kind + ("On" if goal.predicate == "TOGGLEON" else "Off")
    if thing.object_type in STAND_CLOSED:
        draft.say("GoToObject", thing.name)
        draft.say(verb, thing.name)
    elif verb in ("OpenObject", "CloseObject") and "on" in thing.now:
        draft.do_at(thing, "ToggleOff", thing.name)
        draft.do_at(thing, verb, thing.name)
    else:
        draft.do_at(thing, verb, thing.name)
