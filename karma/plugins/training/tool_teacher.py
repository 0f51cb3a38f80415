"""A model that plays tool mode by an expert: it knows the goals of a request, and reads the prompt.

Where objects are it reads in the prompt, as a language model does. Its answers are the expert's
programs as tool calls, and an end.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, NamedTuple

from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.agent.tools.table import TOOL_OF_SKILL
from karma.household.ids import short_type
from karma.household.saying import name_of, plural_of, told_place
from karma.household.states import END_STATES, SAID_AS, deed_for
from karma.household.types import object_types
from karma.models.scripted import ScriptedModel
from karma.types.completion import Completion
from karma.types.planning import EndKind, Prompt
from karma.types.tasks import Goal

_NAME = re.compile(r"(\w+)(?: \(([^)]*)\))?(?: to (\w+))?$")
_AT = re.compile(r"(\w+)(?: \(([^)]*)\))? at (\w+)$")
_SKILL_TOOLS = {**TOOL_OF_SKILL, "SwitchOn": "on", "SwitchOff": "off"}

Things = Mapping[str, NamedThing]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """A request, and what solves it: goals, or calls and an end."""

    kind: str
    text: str
    goals: tuple[Goal, ...] = ()
    search: str = ""  # the call that shows what the end is about
    is_shown: Callable[[Things], bool] | None = None  # what the prompt tells says enough to end
    end: EndKind = "done"
    reply: str = ""  # text of the end


class TaughtAnswer(NamedTuple):
    """An answer of the teacher; a slip is shown and not to be learned."""

    prompt: Prompt
    text: str
    is_slip: bool


@dataclass(slots=True)
class ToolTeacher:
    """A `LanguageModel` that answers by the lesson of the request that the prompt ends in.

    `slip` makes a mistake out of the lines of the first answer to a request.
    """

    lessons: Mapping[str, Lesson]
    slip: Callable[[list[str]], list[str]] = lambda lines: lines
    answers: list[TaughtAnswer] = field(default_factory=list)
    name: str = "tool-teacher"

    def complete(self, prompt: Prompt, **_: Any) -> Completion:
        """Answer with all calls for what the prompt tells, and an end."""
        first = prompt.turns[0][0] if prompt.turns else prompt.changing
        lesson = self.lessons[first.rpartition("Request: ")[2].strip()]
        lines = _answer(lesson, prompt)
        shown = lines if prompt.turns else self.slip(lines)
        text = "\n".join(shown)
        self.answers.append(TaughtAnswer(prompt, text, shown != lines))
        return ScriptedModel([text]).complete(prompt)


def _answer(lesson: Lesson, prompt: Prompt) -> list[str]:
    told = "\n".join([*(user for user, _ in prompt.turns), prompt.changing])
    things, _ = things_told(told)
    end = f'{lesson.end}("{lesson.reply or report(lesson.goals)}")'
    if lesson.goals:
        goals, kind = _apart(lesson.goals, things)
        return [f"find({kind})"] if kind else [*_program(goals, prompt.stable, told), end]
    is_searched = f"{lesson.search} -> " in told
    is_known = lesson.is_shown(things) if lesson.is_shown else is_searched
    if is_searched and not is_known:
        return ['refuse("I have not seen it.")']  # which is no right end
    return [end] if is_known or not lesson.search else [lesson.search]


def _program(goals: Sequence[Goal], system: str, told: str) -> list[str]:
    things, held = things_told(told)
    failed = re.findall(r"^put\((\w+), (\w+)\) -> FAILED", told, re.MULTILINE)
    view = ExpertView(
        things=tuple(things.values()),
        landmarks=_furniture(system, told),
        held=things.get(held, _thing(held, None, None)) if held != "nothing" else None,
        refused=frozenset([*failed, *((what, short_type(place)) for what, place in failed)]),
    )
    is_open = {f"open({name})" for name, thing in things.items() if "opened" in thing.states}
    calls = [call for call in solve(goals, view) if call.skill in _SKILL_TOOLS]
    lines = [f"{_SKILL_TOOLS[call.skill]}({', '.join(call.objects)})" for call in calls]
    acts = [line for line in lines if not line.startswith("go(")]  # the other tools walk, too
    return [line for line in acts or lines if line not in is_open]


def _furniture(system: str, told: str) -> frozenset[str]:
    """Return the types of furniture on the map, and those that were found."""
    rows = system.partition("Furniture")[2].splitlines()[1:]
    mapped = (short_type(name) for row in rows for name in re.findall(r"\w+", row))
    return frozenset((*mapped, *re.findall(r"find\((\w+)\) -> ok", told)))


def _apart(goals: Sequence[Goal], things: Things) -> tuple[list[Goal], str]:
    """Return goals of one object each, and the type of which the prompt tells too few objects."""
    found: list[Goal] = []
    for goal in goals:
        kind, place = goal.arguments[0], goal.arguments[-1]
        alike = [thing for thing in things.values() if thing.object_type == kind]
        away = [thing.name for thing in alike if thing.place_type != place]
        missing = goal.count - (len(alike) - len(away))
        if goal.count == 1:
            found.append(goal)
        elif missing > len(away):
            return [], kind
        else:
            single = (replace(goal, arguments=(name, place), count=1) for name in away)
            found += islice(single, max(missing, 0))
    return found, ""


def report(goals: Sequence[Goal]) -> str:
    """Return goals as a sentence.

    >>> from karma.goals.goals import parse_goal
    >>> report([parse_goal("STATE(Mug, cleaned)"), parse_goal("ON(Mug, Shelf)")])
    'The mug is clean, the mug is on the shelf.'
    """
    text = ", ".join(map(_fact, goals))
    return f"{text[:1].upper()}{text[1:]}."


def _fact(goal: Goal) -> str:
    first, last = goal.arguments[0], goal.arguments[-1]
    if goal.predicate == "HOLDON":
        return f"I hold the {name_of(last)}"
    state = END_STATES.get(goal.predicate) or deed_for(last) or last
    word = told_place(last) if goal.predicate in ("ON", "INSIDE") else SAID_AS.get(state, state)
    if goal.count > 1:
        return f"{goal.count} {plural_of(name_of(first))} are {word}"
    return f"the {name_of(first)} is {word}"


# ----------------------------------------------------------------- what a prompt tells


def things_told(text: str) -> tuple[dict[str, NamedThing], str]:
    """Return the objects of which a text tells, the last used first, and the held one's name."""
    remembered: dict[str, NamedThing] = {}
    seen: dict[str, NamedThing] = {}
    held = "nothing"
    for line in text.splitlines():
        if found := re.match(r"In the hand: (\w+)|pick\((\w+)\) -> ok", line):
            held = found[1] or found[2]
        if re.match(r"(put|near|throw)\(.*\) -> ok", line):
            held = "nothing"
        if line.startswith("Remembered"):
            units = reversed(line.partition(": ")[2].split("; "))
            read = filter(None, (_AT.match(unit.removeprefix("*")) for unit in units))
            remembered |= {unit[1]: _thing(unit[1], unit[2], unit[3]) for unit in read}
        for thing, is_gone in _sights(line.partition("Seen: ")[2]):
            seen[thing.name] = thing
            if is_gone:
                seen.pop(thing.name)
                remembered.pop(thing.name, None)
    first = {name: seen.get(name, thing) for name, thing in remembered.items()}
    return {**first, **seen}, held


def _sights(text: str) -> Iterator[tuple[NamedThing, bool]]:
    """Yield the objects that a text of news names, and whether each is no longer there."""
    for part in filter(None, text.split("; ")):
        place, colon, names = part.rpartition(": ")
        for run in re.split(r", (?![^(]*\))", names):
            for name, states in _names(run):
                yield _thing(name, states, place if colon else None), place == "no longer there"


def _names(text: str) -> list[tuple[str, str]]:
    """Return name and states of a run: "Cup_2 to Cup_4", "Mug (dirty)"."""
    found = _NAME.match(text)
    if found is None:
        return []
    if found[3]:
        base, _, first = found[1].rpartition("_")
        last = int(found[3].rpartition("_")[2])
        return [(f"{base}_{number}", "") for number in range(int(first), last + 1)]
    return [(found[1], found[2] or "")]


def _thing(name: str, states: str | None, place: str | None) -> NamedThing:
    known = place is not None and short_type(place) in object_types()
    return NamedThing(
        name=name,
        object_type=short_type(name),
        states=tuple(states.split(", ")) if states else (),
        place=place if known else None,
        place_type=short_type(place) if place is not None and known else None,
    )
