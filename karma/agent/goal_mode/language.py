"""Language of goal mode: grammar and parser of a small model's answers.

Each line is one wish, such as `put(2 Mug dirty, Sink)`. A description is a count or `all`, a name,
and modifiers: states, `in Fridge` or `on Desk`, or `not` before either. `if(...)` is a condition on
all wishes, `avoid(...)` excludes objects from them, `tell(...)` asks to look and report.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from karma.errors import ProgramError
from karma.household.types import Capability
from karma.types.grammars import any_of, lines_grammar
from karma.types.planning import End, EndKind, Grammar

MAX_LINES = 12
MAX_CHARACTERS = 1_000
MAX_COUNT = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """Reference to objects in the model's words: name, count, required states and locations."""

    name: str
    count: int | None = 1  # None: all of them
    states: tuple[tuple[str, bool], ...] = ()  # a word of STATES, and whether it must hold
    places: tuple[tuple[str, bool], ...] = ()  # name of a receptacle, likewise

    def __str__(self) -> str:
        words = ["all" if self.count is None else "" if self.count == 1 else str(self.count)]
        words.append(self.name)
        words += [("" if holds else "not ") + state for state, holds in self.states]
        words += [("in " if holds else "not in ") + place for place, holds in self.places]
        return " ".join(filter(None, words))


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """A goal in the model's words."""

    verb: str  # a key of VERBS
    what: Description
    where: Description | None = None

    def __str__(self) -> str:
        return f"{self.verb}({self.what}{f', {self.where}' if self.where else ''})"


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalAnswer:
    """A parsed answer: wishes in their order, or an end without any."""

    wishes: tuple[Wish, ...] = ()
    avoided: tuple[Description, ...] = ()
    conditions: tuple[tuple[Description, bool], ...] = ()  # whether such an object must exist
    told: tuple[Description, ...] = ()
    end: End | None = None

    @property
    def descriptions(self) -> tuple[Description, ...]:
        """All descriptions, in their order."""
        found = [d for wish in self.wishes for d in (wish.what, wish.where) if d is not None]
        return (*(d for d, _ in self.conditions), *self.avoided, *found, *self.told)


VERBS: Mapping[str, tuple[int, str, str]] = {
    "put": (2, "ON", ""), "near": (2, "NEAR", ""), "hold": (1, "HOLDON", ""),
    "trash": (1, "ON", ""),
    "clean": (1, "STATE", "cleaned"), "heat": (1, "STATE", "heated"),
    "cook": (1, "STATE", "cooked"), "cool": (1, "STATE", "cooled"),
    "slice": (1, "STATE", "sliced"), "fill": (1, "STATE", "filled"),
    "coffee": (1, "STATE", "filled"), "empty": (1, "STATE", "empty"),
    "break": (1, "STATE", "broken"),
    "open": (1, "OPEN", ""), "close": (1, "CLOSED", ""),
    "on": (1, "TOGGLEON", ""), "off": (1, "TOGGLEOFF", ""),
}  # fmt: skip
"""Verb -> number of arguments, predicate of the goal, state of a STATE goal."""

NEEDS: Mapping[str, tuple[Capability, str]] = {
    **dict.fromkeys(("put", "near", "hold", "trash"), ("pickupable", "picked up")),
    **dict.fromkeys(("open", "close"), ("openable", "opened or closed")),
    **dict.fromkeys(("fill", "coffee"), ("canFillWithLiquid", "filled")),
    "slice": ("sliceable", "sliced"), "break": ("breakable", "broken"),
}  # fmt: skip
"""Verb -> what an object must be capable of, and what an object without it cannot be."""

STATES: Mapping[str, tuple[str, bool]] = {
    "dirty": ("dirty", True), "clean": ("dirty", False), "open": ("opened", True),
    "closed": ("opened", False), "on": ("on", True), "off": ("on", False),
    "sliced": ("sliced", True), "whole": ("sliced", False), "full": ("filled", True),
    "empty": ("filled", False), "hot": ("heated", True), "cold": ("cooled", True),
    "cooked": ("cooked", True), "raw": ("cooked", False), "broken": ("broken", True),
}  # fmt: skip
"""Word -> observed state, and whether the object has it."""

_ENDS: Mapping[str, EndKind] = {"ask": "ask", "refuse": "refuse", "note": "tell"}
_OTHERS = ("if", "avoid", "tell", *_ENDS)
_LINE = re.compile(r"^\W{0,4}([a-zA-Z]+)\((.*?)\)?\s*;?$")

GRAMMAR = Grammar(
    grammar=lines_grammar(
        'wish | "if(" ("not ")? what ")" | "avoid(" what ")" | "tell(" what ")" | end',
        {
            "wish": 'TWO "(" what ", " what ")" | ONE "(" what ")"',
            "end": '("ask" | "refuse" | "note") "(\\"" TEXT "\\")"',
            "what": '(COUNT " ")? NAME (" " ("not ")? (STATE | ("in " | "on ") NAME)){0,3}',
            "TWO": any_of([verb for verb, (count, _, _) in VERBS.items() if count == 2]),
            "ONE": any_of([verb for verb, (count, _, _) in VERBS.items() if count == 1]),
            "STATE": any_of(list(STATES)),
            "COUNT": '"all" | /[2-9]/',
            "NAME": '/[A-Z]/ /[A-Za-z]/{1,24} ("_" /[0-9]/{1,2})?',
            "TEXT": '/[^"\\n]/{1,120}',
        },
        max_lines=MAX_LINES,
    )
)
"""The language for constrained decoding; a name is anything that people call an object."""


def parse_goals(text: str) -> GoalAnswer:
    r"""Read an answer of goal mode.

    Raises:
        ProgramError: a line is none of the language; names the line and what would be.

    >>> parse_goals("if(not Egg in Fridge)\nput(2 Mug dirty, Sink)").wishes[0].what.count
    2
    """
    if len(text) > MAX_CHARACTERS:
        raise ProgramError(f"at most {MAX_CHARACTERS} characters", line=1, code=text[:60])
    wishes: list[Wish] = []
    avoided: list[Description] = []
    conditions: list[tuple[Description, bool]] = []
    told: list[Description] = []
    end: End | None = None
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line or line.startswith(("```", "#")):
            continue
        try:
            verb, inside = _split(line)
            if verb in _ENDS:
                end = end or End(kind=_ENDS[verb], text=inside.strip("\"' "))
            elif verb == "if":
                negated = inside.startswith("not ")
                conditions.append((_description(inside.removeprefix("not ")), not negated))
            elif verb in ("avoid", "tell"):
                (avoided if verb == "avoid" else told).append(_description(inside))
            else:
                wishes.append(_wish(verb, inside))
        except ValueError as error:
            raise ProgramError(str(error), line=number, code=line[:80]) from None
        if number > MAX_LINES:
            raise ProgramError(f"at most {MAX_LINES} lines", line=number, code=line[:80])
    if not (wishes or told or end):
        raise ProgramError("no wish in this answer", line=1, code=text[:60])
    return GoalAnswer(
        wishes=tuple(wishes),
        avoided=tuple(avoided),
        conditions=tuple(conditions),
        told=tuple(told),
        end=None if wishes or told else end,
    )


def _split(line: str) -> tuple[str, str]:
    found = _LINE.match(line)
    if found is None:
        raise ValueError("write one wish a line, such as put(Apple, Fridge)")
    verb = found[1].lower()
    if verb not in VERBS and verb not in _OTHERS:
        known = [*VERBS, *_OTHERS]
        near = get_close_matches(verb, known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
        raise ValueError(f"there is no {verb}; {hint}")
    return verb, found[2].strip()


def _wish(verb: str, inside: str) -> Wish:
    parts = [part.strip(" '\"") for part in inside.split(",")]
    if parts[0] in ("robot", "robots"):
        parts = parts[1:]
    count = VERBS[verb][0]
    if len(parts) != count or not all(parts):
        form = "Apple, Fridge" if count == 2 else "Apple"
        raise ValueError(f"write {verb}({form})")
    what = _description(parts[0])
    return Wish(verb=verb, what=what, where=_description(parts[1]) if count == 2 else None)


def _description(text: str) -> Description:
    words = text.replace(" that is ", " ").strip(" '\"").split()
    count: int | None = 1
    if words and words[0].lower() in ("all", "every", "each"):
        count, words = None, words[1:]
    elif words and words[0].isdecimal():
        count, words = min(max(int(words[0]), 1), MAX_COUNT), words[1:]
    name: list[str] = []
    while words and words[0].lower() not in (*STATES, "in", "not"):
        name.append(words.pop(0))
    if not name:
        raise ValueError(f"{text!r} names no object")
    states: list[tuple[str, bool]] = []
    places: list[tuple[str, bool]] = []
    while words:
        holds = words[0].lower() != "not"
        words = words if holds else words[1:]
        is_place = words[:1] in (["in"], ["on"]) and words[1:] and words[1][0].isupper()
        if is_place:
            places.append((words[1], holds))
            words = words[2:]
        elif words and words[0].lower() in STATES:
            states.append((words.pop(0).lower(), holds))
        else:
            raise ValueError(
                f"{text!r}: after a name come states ({', '.join(STATES)}) or in PLACE"
            )
    return Description(name="".join(name), count=count, states=tuple(states), places=tuple(places))
