"""The true state as the expert's programs are written from it."""

import math
from collections.abc import Iterator, Sequence

from karma.agent.planning.expert import ExpertView, NamedThing
from karma.bench.rows.expert_choices import PLACED, Lessons
from karma.contracts import Goal, TrueObject, Truth
from karma.household.ids import is_id, is_position, part_id, whole_id
from karma.household.pieces import base_type, is_piece
from karma.household.places import FLOOR, STAND_CLOSED
from karma.household.types import object_types
from karma.household.uses import BASIN_OF, with_wholes


class Surroundings:
    """One moment of the world: what is where, what is thought of first, what is shut in.

    Args:
        truth: of that moment.
        used: ids of what was used, the last used last.
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
            landmarks=self._types(),
            held=next((self._named(self._things[name]) for name in self._held), None),
            refused=frozenset(lessons.refused) | moved,
            shunned=shunned,
            in_the_way=in_the_way,
            awkward=frozenset(lessons.awkward),
        )

    def _types(self) -> frozenset[str]:
        return frozenset(with_wholes(thing.object_type for thing in self._things.values()))

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
