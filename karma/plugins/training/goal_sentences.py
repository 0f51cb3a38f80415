"""ALFRED's goal sentences as requests: the plain program; five facts read off any program.

The five facts of a trial are its task type, object, movable receptacle, receptacle or lamp, and
whether the object is sliced (`task_type` and `pddl_params` of its record). A sentence is an example
like any other: its answer is a program, and `facts_of` reads the facts off any program by rule.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from karma.agent.planning.expert import ExpertView
from karma.agent.planning.plain_program import plain_program
from karma.household import uses
from karma.household.ids import short_type
from karma.plugins.alfred.sentences import read_demonstrations
from karma.plugins.rules.language.lexemes import every_word
from karma.types.planning import SkillCall
from karma.types.tasks import Goal

_TYPES = {
    "look_at_obj_in_light": "look", "pick_and_place_simple": "simple",
    "pick_and_place_with_movable_recep": "stack", "pick_clean_then_place_in_recep": "clean",
    "pick_cool_then_place_in_recep": "cool", "pick_heat_then_place_in_recep": "heat",
    "pick_two_obj_and_place": "two",
}  # fmt: skip
_STATES = {"clean": "cleaned", "heat": "heated", "cool": "cooled"}  # deeds, as ALFRED judges


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalFacts:
    """What a goal sentence asks for."""

    task: str  # a value of `_TYPES`
    thing: str
    movable: str  # "" but for "stack"
    place: str  # receptacle, or the lamp of "look"
    sliced: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """One annotator's goal sentence and its truth."""

    text: str
    facts: GoalFacts
    floor_plan: str = ""  # where it was said

    @property
    def wanted(self) -> tuple[Goal, ...]:
        """What is to hold in the end."""
        return goals_of(self.facts, self.facts.thing, self.text.lower())


def read_sentences(path: Path) -> tuple[Sentence, ...]:
    """Return every goal sentence of a file, in order; errors as `read_demonstrations`."""
    return tuple(
        Sentence(
            text=annotation["task_desc"],
            facts=truth_of(trial),
            floor_plan=trial["scene"]["floor_plan"],
        )
        for trial in read_demonstrations(path, dict[str, Any])
        for annotation in trial["turk_annotations"]
    )


def names_its_place(sentence: Sentence) -> bool:
    """Return whether a sentence says where: of one in ten, as "wash a pan", only its trial tells.

    Who learns from these puts what is to be washed somewhere else, too.
    """
    return _place_words(sentence.facts.place).search(sentence.text.lower()) is not None


@cache
def _place_words(place: str) -> re.Pattern[str]:
    entry = every_word().get(place)
    names = (*entry.names, *entry.kinds) if entry else (place.lower(),)
    words = sorted({word for name in names for word in (name, name.split()[-1])})
    return re.compile(rf"\b(?:{'|'.join(map(re.escape, words))})(?:s|es)?\b")


def truth_of(trial: Mapping[str, Any]) -> GoalFacts:
    """Return the facts of a trial's record; basins count as what they are part of."""
    wanted = trial["pddl_params"]
    place = wanted["toggle_target"] or wanted["parent_target"]
    return GoalFacts(
        task=_TYPES[trial["task_type"]],
        thing=wanted["object_target"],
        movable=wanted["mrecep_target"],
        place=uses.without_basin(place),
        sliced=bool(wanted["object_sliced"]),
    )


def goals_of(facts: GoalFacts, thing: str, text: str) -> tuple[Goal, ...]:
    """Return what is to hold in the end.

    `thing` is the object's short name, if memory holds it, else its type. What the text says to
    cook is cooked, not only heated.
    """
    count = 2 if facts.task == "two" else 1
    goals = [replace(_goal("STATE", thing, "sliced"), count=count)] if facts.sliced else []
    if facts.task == "look":
        return (*goals, _goal("HOLDON", "robot", thing), _goal("TOGGLEON", facts.place))
    if facts.task in _STATES:
        cooked = facts.task == "heat" and facts.thing in uses.COOKED and "cook" in text
        goals.append(_goal("STATE", thing, "cooked" if cooked else _STATES[facts.task]))
    top = thing
    if facts.task == "stack":
        goals.append(_goal("ON", thing, facts.movable))
        top = facts.movable
    return (*goals, replace(_goal("ON", top, facts.place), count=count))


def program_of(sentence: Sentence, view: ExpertView) -> tuple[SkillCall, ...]:
    """Return the plain program; for two things the second follows the first."""
    return plain_program(sentence.wanted, view)


def _goal(predicate: str, *arguments: str) -> Goal:
    return Goal(predicate=predicate, arguments=arguments)


# ----------------------------------------------------------------- reading facts off a program


def facts_of(calls: Sequence[SkillCall]) -> GoalFacts | None:
    """Read the five facts off a program; None where it holds none of the seven tasks.

    The last thing put down is what the sentence is about, and where it was put the receptacle; what
    had been put into it before is the object, and it the movable. Without any thing put, what is
    held when a lamp goes on was to be looked at.
    """
    cut = {short_type(call.objects[0]) for call in calls if call.skill == "SliceObject"}
    puts = list(_puts(calls))
    lamp = [short_type(c.objects[0]) for c in calls if c.skill.endswith("On")]
    lamps = [name for name in lamp if name in uses.LAMPS]
    if lamps:
        held = [short_type(call.objects[0]) for call in calls if call.skill == "PickupObject"]
        held = [name for name in held if name not in uses.KNIVES] or held
        if not held:
            return None
        thing = held[-1]
        return GoalFacts(task="look", thing=thing, movable="", place=lamps[-1], sliced=thing in cut)
    if cut:  # the knife is only put out of the way
        last = [put for put in puts if put[0] not in uses.KNIVES]
        puts = last or puts
    if not puts:
        return None
    thing, place = puts[-1]
    task, movable = _task(puts, lamp), ""
    if task == "stack":
        movable, thing = thing, next(t for t, to in puts if to == puts[-1][0])
    return GoalFacts(task=task, thing=thing, movable=movable, place=place, sliced=thing in cut)


def _puts(calls: Sequence[SkillCall]) -> Iterator[tuple[str, str]]:
    for call in calls:
        if call.skill == "PutObject" and len(call.objects) == 2:
            yield short_type(call.objects[0]), uses.without_basin(short_type(call.objects[1]))


def _task(puts: Sequence[tuple[str, str]], switched: Sequence[str]) -> str:
    """Return the task type of a program that ends in putting something somewhere."""
    thing, place = puts[-1]
    if any(to == thing for _, to in puts[:-1]):
        return "stack"
    before = [to for what, to in puts[:-1] if what == thing]
    if uses.FAUCET in switched and uses.SINK in before:
        return "clean"
    if uses.MICROWAVE in switched and uses.MICROWAVE in before:
        return "heat"
    if place in before:
        return "two"
    return "cool" if uses.FRIDGE in before else "simple"
