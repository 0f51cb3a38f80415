"""Which objects the names of goals stand for, to the expert: those for which least is left to do.

All goals of one name are about one object, or about as many as its highest count says, with one
place for all of them. What refusals have taught makes an object dear, never impossible: where
nothing cheaper is left, the way to it is cleared.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, product

from karma.agent.goals.goals import Meanings, alternatives, object_names
from karma.agent.goals.matching import linked
from karma.contracts import Goal, TrueObject
from karma.household.ids import whole_id
from karma.household.pieces import goes_by
from karma.household.states import deed_for

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
    """Chooses objects at one moment.

    Args:
        meanings: what names mean now, and which goals hold.
        rank: object id -> how many others are thought of before.
        shut_in: object id -> id of the container that it is in.
        lessons: what was in vain.
    """

    meanings: Meanings
    rank: Mapping[str, int]
    shut_in: Mapping[str, str]
    lessons: Lessons

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
