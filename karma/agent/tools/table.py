"""The tools that a language model may call, and the parser of its answers.

An answer holds a call per line, `put(Mug, Sink)`, and ends an instruction with one of four
tools that take a text: `done("The mug is clean.")`. Nothing is executed: each line is matched
against the table.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches

from karma.agent.session import LOOK_OVER, SURVEY
from karma.household.types import object_types
from karma.types.grammars import any_of, lines_grammar
from karma.types.planning import End, EndKind, Grammar

MAX_ANSWER_CHARACTERS = 8_000
MAX_LINES = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """A tool and the skill that carries it out."""

    name: str
    arguments: tuple[str, ...]  # names in the prompt
    skill: str
    doc: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolCall:
    """A call as the model wrote it, with names in place of object ids."""

    tool: Tool
    names: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.tool.name}({', '.join(self.names)})"


@dataclass(frozen=True, slots=True, kw_only=True)
class BadCall:
    """A line that cannot be parsed as a tool call, with the reason."""

    text: str
    reason: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolAnswer:
    """The calls of an answer in their order, and how it ends the instruction, if it does."""

    calls: tuple[ToolCall | BadCall, ...] = ()
    end: End | None = None
    dropped: tuple[str, ...] = ()  # lines of prose


def _tool(name: str, arguments: str, skill: str, doc: str) -> Tool:
    return Tool(name=name, arguments=tuple(arguments.split()), skill=skill, doc=doc)


TOOLS: Mapping[str, Tool] = {
    tool.name: tool
    for tool in (
        _tool("go", "X", "GoToObject", ""),
        _tool("look", "X", LOOK_OVER, "on a surface or, opened, in a container"),
        _tool("survey", "", SURVEY, "look around the whole room"),
        _tool("find", "Type", "Explore", "search everywhere; the same call again: one more"),
        _tool("pick", "X", "PickupObject", "with an empty hand"),
        _tool("put", "X Y", "PutObject", "what you hold, in or on Y"),
        _tool("near", "X Y", "PutNear", "what you hold, next to Y"),
        _tool("open", "X", "OpenObject", ""),
        _tool("close", "X", "CloseObject", ""),
        _tool("on", "X", "ToggleOn", ""),
        _tool("off", "X", "ToggleOff", ""),
        _tool("slice", "X", "SliceObject", "knife in hand"),
        _tool("break", "X", "BreakObject", ""),
        _tool("throw", "X", "ThrowObject", "across the room"),
        _tool("empty", "X", "EmptyObject", "pour out"),
    )
}
ENDS: Mapping[str, EndKind] = {"done": "done", "tell": "tell", "ask": "ask", "refuse": "refuse"}
END_DOCS: Mapping[EndKind, str] = {
    "done": "what is true now",
    "tell": "an answer",
    "ask": "a question",
    "refuse": "why not",
}
TOOL_OF_SKILL: Mapping[str, str] = {tool.skill: tool.name for tool in TOOLS.values()}

MAX_TEXT = 300  # characters of an end, under a grammar


def tools_grammar(names: Iterable[str]) -> Grammar:
    """Return the language of answers about objects of some names; a text stands in an end only."""
    one, two, none = (
        [tool.name for tool in TOOLS.values() if len(tool.arguments) == count]
        for count in (1, 2, 0)
    )
    line = 'ONE "(" NAME ")" | TWO "(" NAME ", " NAME ")" | NONE "()" | END "(\\"" TEXT "\\")"'
    rules = {
        "ONE": any_of(one),
        "TWO": any_of(two),
        "NONE": any_of(none),
        "END": any_of(list(ENDS)),
        "NAME": any_of(sorted(set(names) | object_types().keys())),
        "TEXT": f'/[^"\\n]/{{1,{MAX_TEXT}}}',
    }
    return Grammar(grammar=lines_grammar(line, rules, max_lines=MAX_LINES))


_CALL = re.compile(r"^\W{0,4}(?:\d+[.)]\s*)?([A-Za-z_]\w*)\s*\((.*)\)\s*;?\s*(?:#.*)?$")
_END = re.compile(r"^\W{0,4}(?:\d+[.)]\s*)?(done|tell|ask|refuse)\s*\(", re.IGNORECASE)
_NAME = re.compile(r"[\w|+\-. ]{1,100}")
_QUOTES = "\"'“”‘’` "


def parse_answer(text: str) -> ToolAnswer:
    r"""Return the calls of an answer; lines without a call are dropped.

    A call of an unknown tool, or with the wrong number of arguments, is a `BadCall`: it fails when
    its turn comes, after the calls before it. Lines after the end are dropped.

    >>> answer = parse_answer('pick(Mug)\nput(Mug, Sink)\ndone("The mug is in the sink.")')
    >>> [str(call) for call in answer.calls], answer.end.kind
    (['pick(Mug)', 'put(Mug, Sink)'], 'done')
    """
    calls: list[ToolCall | BadCall] = []
    dropped: list[str] = []
    lines = text[:MAX_ANSWER_CHARACTERS].replace("\r", "\n").split("\n")
    for number, line in enumerate(lines):
        line = line.strip()
        if not line or line.startswith(("```", "#")):
            continue
        if found := _END.match(line):
            end = _end(found, line, lines[number + 1 :])
            return ToolAnswer(calls=tuple(calls), end=end, dropped=tuple(dropped))
        if found := _CALL.match(line):
            calls.append(_call(found[1], found[2], line))
        else:
            dropped.append(line)
        if len(calls) > MAX_LINES:
            break
    return ToolAnswer(calls=tuple(calls), dropped=tuple(dropped))


def _end(found: re.Match[str], line: str, rest: list[str]) -> End:
    """Return the end of an answer; its text may span several lines."""
    whole = "\n".join([line[found.end() :], *rest])
    text = whole.rpartition(")")[0] or whole
    if (closed := line[found.end() :].rpartition(")"))[1]:
        text = closed[0]
    return End(kind=ENDS[found[1].lower()], text=" ".join(text.strip(_QUOTES).split()))


def _call(name: str, inside: str, line: str) -> ToolCall | BadCall:
    tool = TOOLS.get(name) or TOOLS.get(name.lower())
    if tool is None:
        near = get_close_matches(name.lower(), [*TOOLS, *ENDS], n=1)
        hint = f"did you mean {near[0]}?" if near else f"tools: {', '.join([*TOOLS, *ENDS])}"
        return BadCall(text=line, reason=f"there is no tool {name}; {hint}")
    names = tuple(part.strip(_QUOTES) for part in inside.split(",") if part.strip(_QUOTES))
    if names[:1] in (("robot",), ("robots",)):  # as in skill calls
        names = names[1:]
    if tool.name == "put" and len(names) == 1:  # a receptacle alone: what is in the hand
        return ToolCall(tool=replace(tool, arguments=("Y",)), names=names)
    if len(names) != len(tool.arguments):
        form = f"{tool.name}({', '.join(tool.arguments)})"
        return BadCall(text=line, reason=f"write {form}")
    if not all(map(_NAME.fullmatch, names)):
        return BadCall(text=line, reason="a name has letters, digits and _ only")
    return ToolCall(tool=tool, names=names)


_SKILL_CALL = re.compile(r"\b([A-Z]\w+)\(robot((?:, '[^']*')*)[^()]*\)")


def in_tools(text: str) -> str:
    """Return a text with tool calls in place of skill calls.

    >>> in_tools("PickupObject(robot, 'Apple') first")
    'pick(Apple) first'
    """

    def tool_call(found: re.Match[str]) -> str:
        name = TOOL_OF_SKILL.get(found[1])
        names = found[2].replace("'", "").removeprefix(", ")
        return f"{name}({names})" if name else found[0]

    return _SKILL_CALL.sub(tool_call, text)
