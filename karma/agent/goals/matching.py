"""Choose the objects that the names of linked goals mean, so that as few goals as possible fail.

For every name as many different objects are chosen as its most demanding goal asks for, fewer only
where there are fewer; for a name that nothing counts, one. A goal of count k about a thing and a
place holds when one chosen place suits at least k of the chosen things.

Things of which the same goals are true are interchangeable, so that forty slices on a table are
one choice, not forty. Nor is a thing worth choosing before another of which more goals are true.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product

from karma.contracts import Goal, TrueObject

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
