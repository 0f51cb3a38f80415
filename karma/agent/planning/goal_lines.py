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
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.contracts import Goal, MemoryUnit, Mention, Request, SaidDeed, Skill, SkillCall
from karma.household import uses
from karma.household.deeds import able_to, deed_kind
from karma.household.ids import short_type
from karma.household.pieces import base_type, piece_type
from karma.household.places import SURFACES, landmark_types
from karma.household.states import DONE_BY, END_STATES
from karma.household.uses import kind_of, switch_of
from karma.plugins.rules.language.request_words import deed_states
from karma.plugins.rules.request_checker import Guard, meant_by

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
_PUT, _NEAR, _HOLD, _COFFEE = "Put", "Near", "Hold", "MakeCoffee"
_MOVES = ("put", "throw")
_BY_DEED = {"put": _PUT, "throw": _PUT, "take": _HOLD, "coffee": _COFFEE}
_BY_STATE = {END_STATES.get(end, end): line for end, line in _BY_END.items()}
_BREWING = Goal(predicate="TOGGLEON", arguments=(uses.COFFEE_MACHINE,))
_TWO: tuple[Literal["object"], ...] = ("object", "object")
GOAL_LINES: tuple[Skill, ...] = (
    Skill(name=_PUT, arguments=_TWO, doc="the first thing lies in or on the second"),
    Skill(name=_NEAR, arguments=_TWO, doc="the first thing lies near the second"),
    *(
        Skill(name=name, arguments=("object",), doc=doc, takes=takes)
        for name, (_, takes, doc) in {
            _HOLD: ("", "pickupable", "the robot has it in its hand"),
            **_STATES,
            _COFFEE: ("", "canFillWithLiquid", "this mug or cup is full of coffee"),
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
    near = {line.objects[1] for line in lines if line.skill == _NEAR}
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
    if line.skill in (_PUT, _NEAR):
        yield Goal(predicate="ON", arguments=line.objects)
    elif line.skill == _HOLD:
        yield Goal(predicate="HOLDON", arguments=("robot", thing))
    elif line.skill == _COFFEE:
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
        found += [line] * (goal.count if line.skill == _PUT else 1)
    return tuple(found)


def _line_of(goal: Goal, *, brews: bool) -> SkillCall | None:
    """Return the line that says a goal, None where there is none."""
    first, *others = (one.partition("/")[0].strip() for one in goal.arguments)
    match goal.predicate:
        case "ON" | "INSIDE":
            name, objects = _PUT, (first, *others)
        case "HOLDON":
            name, objects = _HOLD, tuple(others)
        case "STATE":
            name, objects = _BY_END.get(DONE_BY.get(others[0], others[0]), ""), (first,)
            name = _COFFEE if brews and name == "Fill" else name
        case predicate:
            name, objects = _BY_END.get(predicate, ""), (first,)
    return SkillCall(skill=name, objects=objects) if name else None


def asked_lines(asked: Request, here: Collection[str]) -> tuple[SkillCall, ...]:
    """Return the goals of a request as its words were read, for want of a planner's answer.

    In the order of the deeds; () where one has no line. Each thing has to be one whole of a type,
    not one of several, a piece, or known by its past, its state or what lies in it.
    """
    found: list[SkillCall] = []
    if Guard(asked, here).in_pieces():
        return ()
    for number, deed in enumerate(asked.deeds):
        moved = {kind for one in asked.deeds[number + 1 :] for kind in _moved(one)}
        lines = [_asked_line(deed, one, here) for one in deed.things or (None,)]
        if not all(lines):
            return ()
        held = deed.deed == "take" and moved & {kind for one in deed.things for kind in one.types}
        found += [line for line in lines if line is not None and not held]
    return tuple(dict.fromkeys(found))


def _moved(deed: SaidDeed) -> Iterator[str]:
    """Yield the types of what a deed moves, beside taking it."""
    if deed.deed in _MOVES:
        yield from (kind for one in deed.things for kind in one.types)


def _asked_line(deed: SaidDeed, thing: Mention | None, here: Collection[str]) -> SkillCall | None:
    name = _BY_DEED.get(deed.deed) or _BY_STATE.get(deed_kind(deed.deed).leaves, "")
    name = _NEAR if deed.deed == "put" and deed.near else name
    takes = next((line.takes for line in GOAL_LINES if line.name == name), "")
    objects = [_asked_type(thing, here, takes or "pickupable")]
    match deed.deed:
        case "put":
            objects.append(_asked_type(deed.place, here, "" if deed.near else "receptacle"))
        case "throw":
            objects.append(uses.BIN)
        case "coffee":
            objects = [uses.COFFEE_CUP]
    return SkillCall(skill=name, objects=tuple(objects)) if name and all(objects) else None


def _asked_type(one: Mention | None, here: Collection[str], need: str) -> str:
    """Return the one type that a mention means here; "" where words alone do not tell.

    It has to be what `need` says, "" for anything.
    """
    if one is None or one.told or one.anything or one.every or one.other or one.holding:
        return ""
    if (one.number or 1) > 1:
        return ""
    if deed_states().keys() & one.text.lower().split():  # "the empty roll": a look must tell
        return ""
    kinds = {
        switch_of(kind) if need == "toggleable" and kind not in uses.TAPS else kind_of(kind)
        for kind in meant_by(one, here)
        if not need
        or able_to(kind, need)
        or (need == "cookable" and able_to(piece_type(kind), need))
    }
    return kinds.pop() if len(kinds) == 1 else ""  # "the light": a lamp, or all of them?


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
