"""One moment's objects, what was done to them, and which of them the names of goals mean.

Deeds, as ALFRED keeps them, per object, for ever:

* cleaned: it was in a basin under running water (`Truth.washed`).
* heated: Hot at some moment, or once in a running microwave.
* cooled: it was in a fridge when that was shut, or turned Cold elsewhere.

States, though a temperature fades within seconds in AI2-THOR:

* hot / cold: heated, or Cold at some moment or in a shut fridge; the later of the two counts.

A new slice has all that is so of the whole that it was cut from.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product

from karma.household.ids import is_id, is_part, type_of, whole_id
from karma.household.pieces import is_piece
from karma.household.places import FLOOR
from karma.household.uses import FRIDGE, covers
from karma.types.observation import TrueObject, Truth
from karma.types.tasks import Goal


class ObjectIndex:
    """Finds the objects of one moment."""

    def __init__(self, truth: Truth) -> None:
        self.by_id = {thing.object_id: thing for thing in truth.objects}
        self.held = truth.held_ids
        things = self.by_id.items()
        self._replaced = {whole_id(key) for key, thing in things if is_piece(thing.object_type)}
        self._holders: dict[str, frozenset[str]] = {}

    def named(self, names: Sequence[str]) -> list[TrueObject]:
        """Return the objects that types or ids cover; a cut whole gives way to its pieces."""
        return [
            thing
            for key, thing in self.by_id.items()
            if key not in self._replaced and any(_covers(name, thing) for name in names)
        ]

    def holders(self, thing: TrueObject) -> frozenset[str]:
        """Return what a thing is in or on, also through receptacles that can be carried."""
        if thing.object_id not in self._holders:
            self._holders[thing.object_id] = frozenset(self._climb(thing))
        return self._holders[thing.object_id]

    def is_carried(self, object_id: str) -> bool:
        """Return whether something is in the hand, or in what is there."""
        thing = self.by_id.get(object_id)
        return thing is not None and bool(self.held & {object_id, *self.holders(thing)})

    def _climb(self, thing: TrueObject) -> set[str]:
        found: set[str] = set()
        todo = [thing]
        while todo:
            for parent in todo.pop().parent_ids:
                if parent in found:
                    continue
                found.add(parent)
                if parent in self.by_id and self.by_id[parent].pickupable:
                    todo.append(self.by_id[parent])
        return found


def _covers(name: str, thing: TrueObject) -> bool:
    """Return whether a name means a thing; ALFRED's ids keep words that are no types any more."""
    if is_id(name):
        return thing.object_id == name or is_part(thing.object_id, of=name)
    return covers(name, thing.object_type) or name == type_of(thing.object_id)


DEEDS = ("cleaned", "heated", "cooled")
TEMPERATURES = ("hot", "cold")


class RememberedDeeds:
    """Remembers what was done to things, over the events of one task."""

    def __init__(self) -> None:
        self._done: dict[str, set[str]] = {deed: set() for deed in DEEDS}
        self._now: dict[str, set[str]] = {state: set() for state in TEMPERATURES}
        self._inherited: dict[str, set[str]] = {}  # of a slice: what was done to its whole
        self._ids: set[str] = set()
        self._cold: set[str] = set()  # at the event before
        self._shut_in: set[str] = set()  # likewise: in fridges that are shut

    def update(self, truth: Truth) -> None:
        """Take in one event, in order."""
        ids = {thing.object_id for thing in truth.objects}
        for new in ids - self._ids:
            self._cut_off(new)
        self._ids = ids
        cold = {one.object_id for one in truth.objects if one.temperature == "Cold"}
        cold -= {one.object_id for one in truth.objects if one.object_type == FLOOR}
        self._done["cleaned"] |= truth.washed
        self._done["heated"] |= truth.heated
        self._done["cooled"] |= self._newly_cooled(truth, cold)
        self._become("hot", "cold", set(truth.heated))
        self._become("cold", "hot", cold | truth.cooled)
        self._cold = cold

    def done(self, object_id: str, deed: str, *, itself: bool = False) -> bool:
        """Return whether a deed was done to a thing, or to the whole before it was cut off.

        With `itself` what was done to the whole does not count.
        """
        inherited = not itself and deed in self._inherited.get(object_id, ())
        return inherited or object_id in self._done[deed]

    def is_now(self, object_id: str, temperature: str) -> bool:
        """Return whether a thing is of one of the `TEMPERATURES`."""
        return object_id in self._now[temperature]

    def _cut_off(self, new: str) -> None:
        whole = whole_id(new)
        if whole in self._ids:
            self._inherited[new] = {deed for deed in DEEDS if self.done(whole, deed)}
        for ids in self._now.values():
            if whole in ids:
                ids.add(new)

    def _newly_cooled(self, truth: Truth, cold: set[str]) -> set[str]:
        """Return what was shut in a fridge just now, and what turned cold in none."""
        index = ObjectIndex(truth)
        fridges = {one.object_id for one in truth.objects if one.object_type == FRIDGE}
        shut = {key for key in fridges if "opened" not in index.by_id[key].states}
        chilled = {key: index.holders(index.by_id[key]) for key in cold | truth.cooled}
        turned = {key for key in cold - self._cold if not chilled[key] & fridges}
        found = turned | (truth.cooled - self._shut_in)
        self._shut_in = {one.object_id for one in truth.objects if index.holders(one) & shut}
        return found

    def _become(self, state: str, instead_of: str, ids: set[str]) -> None:
        self._now[state] |= ids
        self._now[instead_of] -= ids


# ----------------------------------------------------------------- which objects linked goals mean
#
# Chosen so that as few goals as possible fail. For every name as many different objects are chosen
# as its most demanding goal asks for, fewer only where there are fewer; for a name that nothing
# counts, one. A goal of count k about a thing and a place holds when one chosen place suits at
# least k of the chosen things.
#
# Things of which the same goals are true are interchangeable, so that forty slices on a table are
# one choice, not forty. Nor is a thing worth choosing before another of which more goals are true.

NamesOf = Mapping[Goal, Sequence[str]]  # the thing's, then the place's
Things = Sequence[TrueObject]
True_ = Callable[[Goal, Things], bool]  # of one object per name


def linked(names_of: NamesOf) -> Iterator[list[Goal]]:
    """Yield the goals in groups; goals of different groups share no name."""
    groups: list[tuple[set[str], list[Goal]]] = []
    for goal, of_goal in names_of.items():
        names, group = set(of_goal), [goal]
        for other in [entry for entry in groups if entry[0] & names]:
            groups.remove(other)
            names, group = names | other[0], other[1] + group
        groups.append((names, group))
    for _, group in groups:
        yield group


def suited(goal: Goal, chosen: Sequence[Things], true: True_) -> int:
    """Return of how many things a goal is true, with the place that suits most of them."""
    things, *places = chosen
    return max(
        (sum(true(goal, (one, *place)) for one in things) for place in product(*places)), default=0
    )


def fewest_missed(names_of: NamesOf, named: Mapping[str, Things], true: True_) -> frozenset[Goal]:
    """Search the choices of objects, depth first, for the fewest missed goals; () for none."""
    names = _in_order(names_of)
    sizes = {name: _size(name, names_of) for name in names}
    due: dict[str, list[Goal]] = {name: [] for name in names}  # by the name chosen last
    for goal, its in names_of.items():
        due[max(its, key=names.index)].append(goal)
    best = frozenset(names_of)

    def choose(depth: int, chosen: Mapping[str, Things], missed: frozenset[Goal]) -> None:
        nonlocal best
        if len(missed) >= len(best):
            return
        if depth == len(names):
            best = missed
            return
        name = names[depth]
        kinds = _kinds(name, names_of, {**named, **chosen}, true)
        for things in _sets(kinds, min(sizes[name], len(named[name]))):
            now = {**chosen, name: things}
            wrong = [goal for goal in due[name] if not meets(goal, now)]
            choose(depth + 1, now, missed | frozenset(wrong))

    def meets(goal: Goal, chosen: Mapping[str, Things]) -> bool:
        return suited(goal, [chosen[name] for name in names_of[goal]], true) >= goal.count

    choose(0, {}, frozenset())
    return best


def _in_order(names_of: NamesOf) -> list[str]:
    """Return the names as they are mentioned; where goals count, places come before things.

    Once the place is chosen, there are few kinds of things left to choose sets of.
    """
    names = list(dict.fromkeys(name for its in names_of.values() for name in its))
    if all(goal.count == 1 for goal in names_of):
        return names
    places = {name for its in names_of.values() for name in its[1:]}
    return sorted(names, key=lambda name: name not in places)


def _size(name: str, names_of: NamesOf) -> int:
    return max((goal.count for goal, its in names_of.items() if its[0] == name), default=1)


Looks = tuple[object, ...]  # whether each goal is true of a thing, with each of the others


def _kinds(
    name: str, names_of: NamesOf, others: Mapping[str, Things], true: True_
) -> dict[Looks, list[TrueObject]]:
    """Return the objects of a name in groups, of which the same goals are true with all others."""
    kinds: dict[Looks, list[TrueObject]] = {}
    for thing in others[name]:
        looks: list[object] = []
        for goal, its in names_of.items():
            if its.count(name) > 1:  # with itself, which is like no other
                looks.append(thing.object_id)
            elif name in its:
                rows = ([thing] if other == name else others[other] for other in its)
                looks += (true(goal, row) for row in product(*rows))
        kinds.setdefault(tuple(looks), []).append(thing)
    return kinds


def _sets(kinds: Mapping[Looks, Things], size: int) -> Iterator[Things]:
    """Yield the ways to take `size` things of some kinds, less those that another is no worse than.

    No set has a thing in it while a better one, of which the same goals and more are true, is out.
    """
    if size == 1:
        yield from ([things[0]] for things in kinds.values())
        return
    best_first = sorted(kinds, key=lambda looks: -sum(one is True for one in looks))
    yield from _filled(best_first, kinds, size, frozenset())


def _filled(
    order: Sequence[Looks], kinds: Mapping[Looks, Things], size: int, left_out: frozenset[Looks]
) -> Iterator[Things]:
    if not order or not size:
        if not size:
            yield ()
        return
    first, *rest = order
    things = kinds[first]
    barred = any(_better(looks, first) for looks in left_out)
    for taken in range(0 if barred else min(size, len(things)), -1, -1):
        out = left_out if taken == len(things) else left_out | {first}
        for others in _filled(rest, kinds, size - taken, out):
            yield (*things[:taken], *others)


def _better(one: Looks, other: Looks) -> bool:
    return all(a is True or a == b for a, b in zip(one, other, strict=True))
