"""To the expert: the true state, and the objects that names of goals stand for: the least to do.

All goals of one name are about one object, or about as many as its highest count says, with one
place for all of them. What refusals have taught makes an object dear, never impossible: where
nothing cheaper is left, the way to it is cleared.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, product

from karma.agent.planning.expert import ExpertView, NamedThing
from karma.goals.goals import Meanings, alternatives, object_names
from karma.goals.objects import linked
from karma.household.ids import is_id, is_position, part_id, whole_id
from karma.household.pieces import base_type, goes_by, is_piece
from karma.household.places import FLOOR, STAND_CLOSED
from karma.household.states import deed_for
from karma.household.types import object_types
from karma.household.uses import BASIN_OF, with_wholes
from karma.types.observation import TrueObject, Truth
from karma.types.tasks import Goal

PLACED = ("ON", "INSIDE")
_CHANGED_ELSEWHERE = ("cleaned", "filled", "heated", "cooked", "cooled")
_LEFT = 4.0  # cost of a goal that does not hold yet
_TROUBLE = 100.0  # of every refusal that a choice has met with
_FULL = 0.25  # of a refusal counts where the place refused another thing
_ABSURD = 10_000.0  # of a thing in itself
_LATER = 0.01  # of every object that is thought of before
_CHOICES = 4000  # of places for a group of names that are compared, the likeliest first

Chosen = Mapping[str, tuple[TrueObject, ...]]  # name -> the objects that it stands for


@dataclass(slots=True)
class Lessons:
    """What refusals have taught in one instruction: how often something came to nothing."""

    refused: Counter[tuple[str, str]] = field(default_factory=Counter)  # a thing in a receptacle
    missed: Counter[str] = field(default_factory=Counter)  # names of what was not got at
    awkward: set[str] = field(default_factory=set)  # ids of what cannot be cut where it lies

    def trouble(self, thing: str, place: str = "") -> float:
        """Return how often it was in vain to get at a thing, or to put it into a place."""
        if not place:
            return self.missed[thing]
        others = sum(
            n for (one, where), n in self.refused.items() if where == place and one != thing
        )
        return self.missed[place] + self.refused[thing, place] + _FULL * others


@dataclass(frozen=True, slots=True)
class Chooser:
    """Chooses objects at one moment."""

    meanings: Meanings  # what names mean now, and which goals hold
    rank: Mapping[str, int]  # object id -> how many others are thought of before
    shut_in: Mapping[str, str]  # object id -> id of the container that it is in
    lessons: Lessons  # what was in vain

    def bound(self, goals: Sequence[Goal]) -> list[tuple[Goal, bool]]:
        """Return the goals in their order with ids for names, each with whether it holds."""
        chosen: dict[str, tuple[TrueObject, ...]] = {}
        for group in linked({goal: object_names(goal) for goal in goals}):
            chosen |= self._choose(group)
        return [one for goal in goals for one in self._bound(goal, chosen)]

    def _choose(self, goals: Sequence[Goal]) -> Chosen:
        """Choose for linked names: the places by comparing all, then the best things for them."""
        candidates = {name: self._named(name) for goal in goals for name in object_names(goal)}
        ones = {name: found for name, found in candidates.items() if found}
        places = [n for n in ones if any(n in object_names(goal)[1:] for goal in goals)]
        best: tuple[float, Chosen] = (float("inf"), {})
        for there in islice(product(*(ones[name] for name in places)), _CHOICES):
            chosen: dict[str, tuple[TrueObject, ...]] = {}
            chosen |= {name: (place,) for name, place in zip(places, there, strict=True)}
            price = sum(self._cost(n, one, goals, chosen, ones) for n, (one,) in chosen.items())
            for name in ones:
                if name not in places and price < best[0]:
                    costs = [self._cost(name, one, goals, chosen, ones) for one in ones[name]]
                    order = sorted(range(len(costs)), key=costs.__getitem__)[: _size(name, goals)]
                    chosen[name] = tuple(ones[name][number] for number in order)
                    price += sum(costs[number] for number in order)
            if price < best[0]:
                best = (price, chosen)
        return best[1]

    def _named(self, name: str) -> list[TrueObject]:
        """Return the objects that a name may mean, the likeliest first; a sink for its basin."""
        ones = self.meanings.named(name)
        ids = {one.object_id for one in ones}
        words = alternatives(name)

        def order(one: TrueObject) -> tuple[int, int]:
            fits = (goes_by(word, one.object_id, one.object_type) for word in words)
            return next((n for n, fit in enumerate(fits) if fit), 0), self.rank[one.object_id]

        return sorted((one for one in ones if whole_id(one.object_id) not in ids), key=order)

    def _cost(
        self,
        name: str,
        one: TrueObject,
        goals: Sequence[Goal],
        chosen: Chosen,
        ones: Mapping[str, Sequence[TrueObject]],
    ) -> float:
        """Return what is left to do with an object that a name may stand for, in no unit."""
        cost = ones[name].index(one) * _LATER
        for goal in goals:
            first, *others = object_names(goal)
            if first != name or not all(other in chosen for other in others):
                continue
            things = [one, *(chosen[other][0] for other in others)]
            if len(things) > 1 and one is things[1]:
                cost += _ABSURD
            elif not self.meanings.true(goal, things):
                cost += _LEFT + _TROUBLE * self._trouble(things)
        return cost

    def _trouble(self, things: Sequence[TrueObject]) -> float:
        """Return how often it was in vain to get at things, or to put the first into another."""
        ids = [thing.object_id for thing in things]
        trouble = self.lessons.trouble(ids[0])
        trouble += sum(self.lessons.trouble(ids[0], place) for place in ids[1:])
        return trouble + sum(self.lessons.trouble(self.shut_in.get(one, "")) for one in ids)

    def _bound(self, goal: Goal, chosen: Chosen) -> Iterator[tuple[Goal, bool]]:
        """Yield a goal with ids for names, once for each thing that it counts, and if it holds."""
        first, *others = object_names(goal)
        if not all(chosen.get(name) for name in (first, *others)):
            return
        places = [chosen[name][0] for name in others]
        true = [self.meanings.true(goal, [one, *places]) for one in chosen[first]]
        pairs = sorted(zip(chosen[first], true, strict=True), key=lambda pair: not pair[1])
        for one, holds in pairs[: goal.count]:
            ids = {name: place.object_id for name, place in zip(others, places, strict=True)}
            ids[first] = one.object_id
            arguments = tuple(ids.get(argument, argument) for argument in goal.arguments)
            yield replace(goal, arguments=arguments, count=1), holds


def left(bound: Sequence[tuple[Goal, bool]]) -> list[Goal]:
    """Return which of the bound goals are left to do.

    What holds is among them where doing the rest would end it: a placement of a thing that has to
    be changed elsewhere, and what is in the hand.
    """
    undone = [goal for goal, holds in bound if not holds]
    moved = {
        goal.arguments[0]
        for goal in undone
        if goal.predicate == "STATE" and deed_for(goal.arguments[1]) in _CHANGED_ELSEWHERE
    }
    return [
        goal
        for goal, holds in bound
        if not holds
        or (goal.predicate in PLACED and goal.arguments[0] in moved)
        or (goal.predicate == "HOLDON" and undone)
    ]


def _size(name: str, goals: Sequence[Goal]) -> int:
    """Return how many objects a name stands for."""
    return max((goal.count for goal in goals if object_names(goal)[0] == name), default=1)


class Surroundings:
    """One moment of the world: what is where, what is thought of first, what is shut in.

    `used`: ids, the last used last.
    """

    def __init__(self, truth: Truth, used: Sequence[str]) -> None:
        self._things = {thing.object_id: thing for thing in truth.objects}
        self._held = truth.held_ids
        cut = {whole_id(name) for name, one in self._things.items() if is_piece(one.object_type)}
        last = {object_id: number for number, object_id in enumerate(used)}
        order = sorted(
            self._things.values(),
            key=lambda t: (
                t.object_id not in self._held,
                -last.get(t.object_id, -1),
                t.distance_m,
                t.object_id,
            ),
        )
        self.rank = {thing.object_id: number for number, thing in enumerate(order)}
        self._order = [thing for thing in order if thing.object_id not in cut]
        shut = ((t.object_id, self._container(t)) for t in order)
        self.shut_in = {name: container for name, container in shut if container}

    def view(self, lessons: Lessons, goals: Sequence[Goal]) -> ExpertView:
        """Return all there is, with what was learned; what bound goals place stays there."""
        points = [g.arguments[1] for g in goals if is_position(g.arguments[-1])]
        spots = tuple(NamedThing(name=at, object_type=at, holds=False) for at in points)
        shunned = frozenset(self._shunned(lessons))
        in_the_way = dict(self._in_the_way(lessons, shunned, goals))
        moved = {(o, r) for r, others in in_the_way.items() for o in others}
        return ExpertView(
            things=(*(self._named(thing) for thing in self._order), *spots),
            landmarks=frozenset(with_wholes(one.object_type for one in self._things.values())),
            held=next((self._named(self._things[name]) for name in self._held), None),
            refused=frozenset(lessons.refused) | moved,
            shunned=shunned,
            in_the_way=in_the_way,
            awkward=frozenset(lessons.awkward),
        )

    def _named(self, thing: TrueObject) -> NamedThing:
        place = self.shut_in.get(thing.object_id)
        return NamedThing(
            name=thing.object_id,
            object_type=thing.object_type,
            states=("sliced",) if is_piece(thing.object_type) else (),
            place=place,
            place_type=self._things[place].object_type if place else None,
            holds=thing.receptacle or thing.object_type in BASIN_OF,
            contents=tuple(self._contents(thing)),
            now=thing.states,
        )

    def _container(self, thing: TrueObject) -> str:
        """Return the id of what has to be opened for a thing, also where a bowl holds it in there.

        "" for none.
        """
        todo, seen = list(thing.parent_ids), set[str]()
        while todo:
            place = self._things.get(todo.pop(0))
            if place is None or place.object_id in seen:
                continue
            seen.add(place.object_id)
            kind = object_types()[place.object_type]
            shuts = place.object_type in STAND_CLOSED or kind.must_be_open
            if place.openable and shuts and not (place.pickupable and "opened" in place.states):
                return place.object_id
            if place.pickupable:
                todo += place.parent_ids
        return ""

    def _contents(self, thing: TrueObject) -> Iterator[str]:
        """Yield the ids of what can be taken out of a thing by itself, the largest first."""
        basin = self._things.get(part_id(thing.object_id, BASIN_OF.get(thing.object_type, "")))
        inside = {*thing.child_ids, *(basin.child_ids if basin else ())}
        loose = [self._things[name] for name in inside if name in self._things]
        loose = [one for one in loose if one.pickupable and inside.isdisjoint(self._dishes(one))]
        loose.sort(key=lambda one: (-math.prod(one.box_size_m), one.object_id))
        yield from (one.object_id for one in loose)

    def _dishes(self, thing: TrueObject) -> set[str]:
        places = (self._things.get(name) for name in thing.parent_ids)
        return {place.object_id for place in places if place is not None and place.pickupable}

    def _shunned(self, lessons: Lessons) -> Iterator[str]:
        """Yield what is not to be used while there is another of its type that may do."""
        bad = {name for name in lessons.missed if is_id(name)}
        bad |= {place for _, place in lessons.refused if is_id(place)}
        for name in sorted(bad & self._things.keys()):
            kind = base_type(self._things[name].object_type)
            ones = (o for o, t in self._things.items() if base_type(t.object_type) == kind)
            if not bad.issuperset(ones):
                yield name

    def _in_the_way(
        self, lessons: Lessons, shunned: frozenset[str], goals: Sequence[Goal]
    ) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Yield what has no other of its type that may do, with what to put elsewhere first."""
        busy = {goal.arguments[0] for goal in goals if goal.predicate in PLACED} | self._held
        stuck = set(lessons.missed)
        full = {place for _, place in lessons.refused if place in self._things}
        for name in sorted(full - shunned):
            others = [one for one in self._contents(self._things[name]) if one not in busy | stuck]
            if others:
                yield name, tuple(others[:1])
        hidden = {name for name in lessons.missed if name in self._things and name not in full}
        for name in sorted(hidden - shunned):
            if self._things[name].pickupable:
                others = [one for one in self._neighbours(name) if one not in busy | stuck]
                yield name, tuple(others[: lessons.missed[name]])

    def _neighbours(self, name: str) -> list[str]:
        """Return the ids of what lies about a thing in the same place, the nearest first."""
        thing = self._things[name]
        places = {place for place in thing.parent_ids if not place.startswith(FLOOR)}
        near = [
            one
            for one in self._things.values()
            if one.pickupable and one is not thing and places & set(one.parent_ids)
            if one.object_id not in places and name not in one.parent_ids
        ]
        near.sort(key=lambda one: (math.dist(one.position_m, thing.position_m), one.object_id))
        return [one.object_id for one in near]
