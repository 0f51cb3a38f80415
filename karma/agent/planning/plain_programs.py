"""Plain programs: what is to be done with what, and nothing that the agent's inspector adds.

A few million parameters learn which things a sentence means; whether a thing's place is known, what
it is shut in and what is in the hand are looked up by rule (the inspector's `mend`) when a program
is about to run. So the programs to learn from say none of that: no searches, no way round through a
closed container, no freeing of the hand.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from karma.agent.planning.expert import ExpertView, solve
from karma.contracts import Goal, SkillCall
from karma.household.ids import short_type
from karma.household.pieces import base_type
from karma.household.places import SURFACES, landmark_types


def plain_program(goals: Sequence[Goal], view: ExpertView) -> tuple[SkillCall, ...]:
    """Return the expert's program as if every place was known and open and the hand free.

    Only names, types and states of the view's things are looked at.
    """
    things = tuple(replace(thing, place=None, place_type=None) for thing in view.things)
    known = ExpertView(things=things, landmarks=frozenset(landmark_types()))
    rounds = list(_rounds(goals, known))
    calls = [call for some in rounds for call in solve(some, known)]
    wanted = {goal.arguments for some in rounds for goal in some}
    kept: list[SkillCall] = []
    for call in calls:
        if call.skill == "Explore":
            continue
        if call.skill == "PutObject" and call.objects[1] in SURFACES and call.objects not in wanted:
            kept.pop()  # the walk to where the hand is freed
            continue
        kept.append(call)
    return tuple(kept)


def _rounds(goals: Sequence[Goal], view: ExpertView) -> Iterator[list[Goal]]:
    """Yield the goals for one thing after the other where they count, else as they are.

    The second thing goes by its own name where it is known, else by its type as the first. What is
    cut once gives slices enough.
    """
    for number in range(max((goal.count for goal in goals), default=0)):
        due = [goal for goal in goals if goal.count > number]
        if number:
            due = [goal for goal in due if goal.arguments[-1] != "sliced"]
        yield [_about(goal, number, view) for goal in due]


def _about(goal: Goal, number: int, view: ExpertView) -> Goal:
    if not number:
        return replace(goal, count=1)
    name, *others = goal.arguments
    same = [one.name for one in view.things if base_type(one.object_type) == short_type(name)]
    names = [name, *(other for other in same if other != name)]
    return replace(
        goal, arguments=(names[number] if number < len(names) else name, *others), count=1
    )
