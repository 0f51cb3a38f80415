"""A model that plays tool mode by the goals of a task: an upper bound that reads prompts only.

It knows what each instruction wants, not where anything is: that it reads in the prompt, as a
language model does. Its programs are the expert's.
"""

import re
from collections.abc import Mapping, Sequence

from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.agent.tools.table import TOOL_OF_SKILL
from karma.goals.goals import Goal
from karma.household.ids import short_type
from karma.household.places import landmark_types
from karma.household.types import object_types
from karma.types.completion import Completion

_TOLD = re.compile(r"(\w+)(?: \(([^)]*)\))?(?: to (\w+))?$")
_SKILL_TOOLS = {**TOOL_OF_SKILL, "SwitchOn": "on", "SwitchOff": "off"}
_AT = re.compile(r"(\w+)(?: \(([^)]*)\))? at (\w+)$")


class ToolPlayer:
    """A `LanguageModel` that answers with the expert's calls for the goals of an instruction."""

    name = "tool-player"

    def __init__(self, goals: Mapping[str, Sequence[Goal]]) -> None:
        self._goals = goals

    def complete(self, prompt, **_):
        """Answer with the whole program for what the prompt tells, and `done`."""
        first = prompt.turns[0][0] if prompt.turns else prompt.changing
        request = first.rpartition("Request: ")[2].strip()
        lines = self._program(prompt, request) if len(prompt.turns) < 12 else []
        text = "\n".join([*lines, 'done("It is as you asked.")'])
        return Completion(
            text=text, finish="stop", prompt_tokens=len(prompt.text) // 4, reused_tokens=0,
            completion_tokens=len(text) // 4, first_token_s=0.0, total_s=0.0,
        )  # fmt: skip

    def _program(self, prompt, request: str) -> list[str]:
        things, held = things_told([user for user, _ in prompt.turns] + [prompt.changing])
        failed = [
            line for user, _ in prompt.turns for line in user.splitlines() if "FAILED" in line
        ]
        failed += [line for line in prompt.changing.splitlines() if "FAILED" in line]
        refused = {
            (found[1], found[2])
            for line in failed
            if (found := re.match(r"put\((\w+), (\w+)\)", line))
        }
        view = ExpertView(
            things=tuple(things.values()),
            landmarks=frozenset(landmark_types()),
            held=things.get(held),
            refused=frozenset(refused | {(a, short_type(b)) for a, b in refused}),
        )
        calls = solve(self._goals[request], view)
        return [
            f"{_SKILL_TOOLS[call.skill]}({', '.join(call.objects)})"
            for call in calls
            if call.skill in _SKILL_TOOLS
        ]


def things_told(messages: Sequence[str]) -> tuple[dict[str, NamedThing], str]:
    """Return the objects that messages tell of, by name, and the name of the held one."""
    things: dict[str, NamedThing] = {}
    held = ""
    for message in messages:
        for line in message.splitlines():
            if line.startswith("In the hand: "):
                held = line.removeprefix("In the hand: ")
            if line.startswith("Remembered"):
                for part in line.partition(": ")[2].split("; "):
                    if found := _AT.match(part.removeprefix("*")):
                        things.setdefault(found[1], _thing(found[1], found[2], found[3]))
            seen = line.partition("Seen: ")[2]
            for part in seen.split("; ") if seen else ():
                place, colon, names = part.partition(": ")
                for name in names.split(", ") if colon else ():
                    for told in _names(name):
                        if place == "no longer there":
                            things.pop(told[0], None)
                        else:
                            things[told[0]] = _thing(*told, place)
            if (done := re.match(r"pick\((\w+)\) -> ok", line)) is not None:
                held = done[1]
            if re.match(r"(put|near|throw)\(.*\) -> ok", line):
                held = "nothing"
    return things, held


def _names(text: str) -> list[tuple[str, str]]:
    """Return the names of a run, "Cup_2 to Cup_4", each with its states."""
    found = _TOLD.match(text)
    if found is None:
        return []
    if found[3]:
        base, _, first = found[1].rpartition("_")
        last = int(found[3].rpartition("_")[2])
        return [(f"{base}_{number}", "") for number in range(int(first), last + 1)]
    return [(found[1], found[2] or "")]


def _thing(name: str, states: str | None, place: str) -> NamedThing:
    kind = short_type(name)
    words = tuple((states or "").split(", ")) if states else ()
    known = place and short_type(place) in object_types()
    return NamedThing(
        name=name,
        object_type=kind,
        states=words,
        place=place if known else None,
        place_type=short_type(place) if known else None,
    )
