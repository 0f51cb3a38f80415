"""Goals as answers: a planner says what is to be so, and the expert writes the program for it.

Lines of goals have a quarter of a program's tokens and nothing of the order of steps, which models
that were not trained for it get wrong. It has the form of a skill call, so that grammar, parser
and recovery are those of programs.

The expert's programs are made plain: what is to be done with what, and nothing that the agent's
inspector adds. A few million parameters learn which things a sentence means; whether a thing's
place is known, what it is shut in and what is in the hand are looked up by rule (the inspector's
`mend`) when a program is about to run. So the programs to learn from say none of that: no searches,
no way round through a closed container, no freeing of the hand.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.household import uses
from karma.household.ids import short_type
from karma.household.pieces import base_type
from karma.household.places import SURFACES, landmark_types
from karma.household.states import DONE_BY, END_STATES
from karma.types.memory import MemoryUnit
from karma.types.planning import Skill, SkillCall
from karma.types.tasks import Goal

_STATES = {
    "Clean": ("cleaned", "", "it was washed or rinsed"),
    "Heat": ("heated", "", "it was warmed up"),
    "Cook": ("cooked", "cookable", "it is cooked, fried, boiled or toasted"),
    "Cool": ("cooled", "", "it was chilled"),
    "Slice": ("sliced", "sliceable", "it is cut"),
    "Fill": ("filled", "canFillWithLiquid", "it is full of water"),
    "Empty": ("empty", "", "nothing is in it"),
    "Break": ("broken", "breakable", "it is broken"),
    "Open": ("OPEN", "openable", "it is open"),
    "Close": ("CLOSED", "openable", "it is closed"),
    "TurnOn": ("TOGGLEON", "toggleable", "it is on; the Faucet is a tap"),
    "TurnOff": ("TOGGLEOFF", "toggleable", "it is off"),
}  # line -> state, or the predicate that ends in one; what a thing must be; words
_BY_END = {end: line for line, (end, _, _) in _STATES.items()}
PUT, NEAR, HOLD, COFFEE = "Put", "Near", "Hold", "MakeCoffee"
LINE_OF_STATE = {END_STATES.get(end, end): line for end, line in _BY_END.items()}
_BREWING = Goal(predicate="TOGGLEON", arguments=(uses.COFFEE_MACHINE,))
_TWO: tuple[Literal["object"], ...] = ("object", "object")
GOAL_LINES: tuple[Skill, ...] = (
    Skill(name=PUT, arguments=_TWO, doc="the first thing lies in or on the second"),
    Skill(name=NEAR, arguments=_TWO, doc="the first thing lies near the second"),
    *(
        Skill(name=name, arguments=("object",), doc=doc, takes=takes)
        for name, (_, takes, doc) in {
            HOLD: ("", "pickupable", "the robot has it in its hand"),
            **_STATES,
            COFFEE: ("", "canFillWithLiquid", "this mug or cup is full of coffee"),
        }.items()
    ),
)
"""What may be said to be so; `doc` is what the prompt says of a line."""


def program_for(
    lines: Sequence[SkillCall], units: Sequence[MemoryUnit], names: Mapping[str, str]
) -> tuple[SkillCall, ...]:
    """Return the plain program that makes goals true; () where nothing is left to do.

    `units` are those that the prompt told of, `names` its short names (-> id).
    """
    unit_of = {unit.object_id: unit for unit in units}
    near = {line.objects[1] for line in lines if line.skill == NEAR}
    units_of = {name: unit_of[one] for name, one in names.items() if one in unit_of}
    things = [
        NamedThing(
            name=name,
            object_type=units_of[name].object_type if name in units_of else short_type(name),
            states=units_of[name].states if name in units_of else (),
            holds=name not in near,
        )
        for name in (*units_of, *(near - units_of.keys()))
    ]
    counts = Counter(goal for line in lines for goal in _goals(line))
    goals = [replace(goal, count=count) for goal, count in counts.items()]
    return plain_program(goals, ExpertView(things=tuple(things)))


def _goals(line: SkillCall) -> Iterator[Goal]:
    """Yield the goals of a line."""
    thing = line.objects[0]
    if line.skill in (PUT, NEAR):
        yield Goal(predicate="ON", arguments=line.objects)
    elif line.skill == HOLD:
        yield Goal(predicate="HOLDON", arguments=("robot", thing))
    elif line.skill == COFFEE:
        yield Goal(predicate="STATE", arguments=(thing, "filled"))
        yield _BREWING
    elif (end := _STATES[line.skill][0]) in END_STATES:
        yield Goal(predicate=end, arguments=(thing,))
    else:
        yield Goal(predicate="STATE", arguments=(thing, end))


def as_lines(goals: Sequence[Goal]) -> tuple[SkillCall, ...]:
    """Return goals as the lines of an answer, a count as the same line again.

    Of names that will do alike the first is said. () where a goal has no line.
    """
    fills = any(goal.predicate == "STATE" and goal.arguments[1] == "filled" for goal in goals)
    brews = fills and _BREWING in goals
    found: list[SkillCall] = []
    for goal in goals:
        if brews and goal == _BREWING:
            continue
        if (line := _line_of(goal, brews=brews)) is None:
            return ()
        found += [line] * (goal.count if line.skill == PUT else 1)
    return tuple(found)


def _line_of(goal: Goal, *, brews: bool) -> SkillCall | None:
    """Return the line that says a goal, None where there is none."""
    first, *others = (one.partition("/")[0].strip() for one in goal.arguments)
    match goal.predicate:
        case "ON" | "INSIDE":
            name, objects = PUT, (first, *others)
        case "HOLDON":
            name, objects = HOLD, tuple(others)
        case "STATE":
            name, objects = _BY_END.get(DONE_BY.get(others[0], others[0]), ""), (first,)
            name = COFFEE if brews and name == "Fill" else name
        case predicate:
            name, objects = _BY_END.get(predicate, ""), (first,)
    return SkillCall(skill=name, objects=objects) if name else None


# ----------------------------------------------------------------- plain programs


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
