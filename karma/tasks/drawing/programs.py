"""Plain programs: what is to be done with what, and nothing that the agent's inspector adds.

A few million parameters learn which things a sentence means; whether a thing's place is known, what
it is shut in and what is in the hand are looked up by rule (the inspector's `mend`) when a program
is about to run. So the programs to learn from say none of that: no searches, no way round through a
closed container, no freeing of the hand.
"""

from collections.abc import Sequence
from dataclasses import replace

from karma.contracts import Area, Goal, SkillCall
from karma.household.places import SURFACES, landmark_types
from karma.tasks.expert import ExpertView, solve


def plain_program(goals: Sequence[Goal], view: ExpertView) -> tuple[SkillCall, ...]:
    """Return the expert's program as if every place was known and open and the hand free.

    Args:
        goals: in the order in which they are to come true.
        view: only the things' names, types and states are looked at.
    """
    things = tuple(replace(thing, place=None, place_type=None) for thing in view.things)
    home = Area(name="home", position_m=(0.0, 0.0, 0.0), contains=tuple(sorted(landmark_types())))
    calls = solve(goals, ExpertView(things=things, areas=(home,)))
    wanted = {goal.arguments for goal in goals}
    kept: list[SkillCall] = []
    for call in calls:
        if call.skill == "Explore":
            continue
        if call.skill == "PutObject" and call.objects[1] in SURFACES and call.objects not in wanted:
            kept.pop()  # the walk to where the hand is freed
            continue
        kept.append(call)
    return tuple(kept)
