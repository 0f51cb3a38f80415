"""What a sub-task needs: the things that can be carried which its goals speak of."""

from collections.abc import Iterable
from functools import cache

from karma.agent.goals.goals import alternatives, object_names, parse_goal
from karma.agent.journal.records import EpisodeRecord
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.types import types_with

Need = frozenset[str]  # types of which any will do


@cache
def needs(goals: tuple[str, ...]) -> tuple[Need, ...]:
    """Return the things that can be carried which goals speak of, in order.

    >>> needs(("INSIDE(Apple/Tomato, Fridge): 1", "HOLDON(robot, Mug): 1"))[1]
    frozenset({'Mug'})
    """
    found = (frozenset(map(base_type, group)) for group in _loose(goals))
    return tuple(dict.fromkeys(found))


def related_needs(record: EpisodeRecord) -> list[tuple[Need, ...]]:
    """Return for each sub-task the needs that an earlier one of the same room had too."""
    spoken: dict[str, set[str]] = {}
    found = []
    for sub in record.subtasks:
        mine, here = needs(sub.goals), spoken.setdefault(sub.scene, set())
        found.append(tuple(need for need in mine if need & here))
        here.update(*mine)
    return found


def types_of(object_ids: Iterable[str]) -> frozenset[str]:
    """Return the types of some ids; pieces count for their whole.

    >>> sorted(types_of(["Apple|+1|+1|+0|AppleSliced_2", "Mug|+0|+1|+0"]))
    ['Apple', 'Mug']
    """
    return frozenset(base_type(root_type(object_id)) for object_id in object_ids)


def wanted_types(goals: tuple[str, ...]) -> tuple[str, ...]:
    """Return every type that the goals allow, once: what a record's queries and hits count."""
    return tuple(dict.fromkeys(kind for group in _loose(goals) for kind in group))


@cache
def _loose(goals: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return for each name in the goals its alternatives that can be carried, if it has any."""
    groups = (
        tuple(root_type(kind) for kind in alternatives(name))
        for text in goals
        for name in object_names(parse_goal(text))
    )
    loose = (tuple(k for k in group if k in types_with("pickupable")) for group in groups)
    return tuple(group for group in loose if group)
