"""Plain programs of the expert: skill calls as if every place was known and open, the hand free.

Small planners learn these programs and copy them from examples. The inspector's `mend` adds
searches, doors and putting down when a program is about to run.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from karma.agent.planning.expert import ExpertView, solve
from karma.household.ids import short_type
from karma.household.pieces import base_type
from karma.household.places import SURFACES, landmark_types
from karma.types.planning import SkillCall
from karma.types.tasks import Goal


def plain_program(goals: Sequence[Goal], view: ExpertView) -> tuple[SkillCall, ...]:
    """Return the plain program that makes goals true; () if nothing is left to do.

    Of the view's objects only names, types and states count.
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
    """Yield the goals of the first object, then of the second, up to the highest count.

    The second object goes by its own name if it is known, else by its type. Slicing counts once.
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
