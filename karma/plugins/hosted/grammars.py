"""Write the language of a spec, of programs or of plans, as servers take it.

GBNF are llama.cpp's grammars; XGrammar reads them too. For servers that enforce JSON schemas only,
a program is
`{"program": [{"skill": "PutObject", "object": "Mug", "object_2": "Sink"}, ...]}`: a call is an
object with its arguments by kind, in the order in which a line has them. Who may refuse may say
`{"program": {"refuse": "thing"}}`.
"""

import json
from collections.abc import Sequence
from typing import Any

import msgspec

from karma.models.automaton import (
    CLOSINGS,
    Argument,
    LineForm,
    as_json,
    forms,
    items_of,
    refusal_lines,
)
from karma.types.planning import REFUSAL_KINDS, PlanSpec, ProgramSpec, RefusedRequest, SkillCall

_CLASS = r"[ !#-\[\]-~]"  # printable ASCII without quotes and backslashes


def gbnf(spec: ProgramSpec) -> str:
    r"""Return the grammar of programs, one rule a line; its root is the rule `root`.

    Raises:
        ValueError: the spec admits no program.

    >>> from karma.types.planning import Skill
    >>> go = Skill(name="GoToObject", arguments=("object",))
    >>> print(gbnf(ProgramSpec(skills=(go,), objects=("Mug", "Sink"), max_calls=3)))
    root ::= line ("\n" line){0,2} ("\n" ("\n" | "```" | "#")?)?
    line ::= "GoToObject" "(robot" ", '" names0 ")"
    names0 ::= ("Mug" | "Sink") "'"
    """
    kinds = forms(spec)
    lists = list(dict.fromkeys(one.names for form in kinds for one in form.arguments))
    rule_of = {names: f"names{number}" for number, names in enumerate(lists)}

    def argument(one: Argument) -> str:
        name = f"""{literal(", '")} {rule_of[one.names]}"""
        if not one.most:
            return name
        more = f"({name}){{0,{one.most - 1}}} " if one.most > 1 else ""
        return f"""{literal(", ['")} {rule_of[one.names]} {more}{literal("]")}"""

    def line(form: LineForm) -> str:
        before = [_any(form.skills), literal("(robot")]
        rest: list[str] = []  # an argument that may be left out holds those behind it
        for one in reversed(form.arguments[form.needed :]):
            rest = [f"({' '.join([argument(one), *rest])})?"]
        needed = map(argument, form.arguments[: form.needed])
        return " ".join([*before, *needed, *rest, literal(")")])

    newline = literal("\n")
    more = f" ({newline} line){{0,{spec.max_calls - 1}}}" if spec.max_calls > 1 else ""
    refusals = [f"{literal(line)} {newline}?" for line in refusal_lines(spec)]
    program = f"root ::= line{more} ({newline} {_any(CLOSINGS)}?)?"
    rules = [
        " | ".join([program, *refusals]),
        f"line ::= {' | '.join(map(line, kinds))}",
        *(f'{rule} ::= {_any(names)} "\'"' for names, rule in rule_of.items()),
    ]
    return "\n".join(rules)


def literal(text: str) -> str:
    r"""Return a text as a terminal of GBNF.

    >>> print(literal('a "b"'))
    "a \"b\""
    """
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def _any(words: Sequence[str]) -> str:
    terminals = " | ".join(map(literal, words))
    return terminals if len(words) == 1 else f"({terminals})"


def plan_gbnf(spec: PlanSpec) -> str:
    """Return the grammar of plans; errors as those of `plan_frame`."""
    items = " | ".join(map(literal, items_of(spec)))
    parts = [literal("{")]
    for key in spec.texts:
        parts += [literal(f'{as_json(key)}:"'), "text", literal('",')]
    parts.append(literal(f"{as_json(spec.plan)}:["))
    more = f' ("," item){{0,{spec.max_actions - 1}}}' if spec.max_actions > 1 else ""
    parts.append(f"(item{more})?")
    return "\n".join(
        (
            f"root ::= {' '.join([*parts, literal(']}')])}",
            f"text ::= {_CLASS}{{0,{spec.max_text}}}" if spec.max_text else 'text ::= ""',
            f"item ::= {items}",
        )
    )


def plan_schema(spec: PlanSpec) -> dict[str, Any]:
    """Return the JSON schema of plans; errors as those of `plan_frame`."""
    action = object_schema(
        {
            spec.number: {"type": "integer", "minimum": 0, "maximum": len(spec.actions) - 1},
            spec.name: {"type": "string"},
        }
    )
    text = {"type": "string", "maxLength": spec.max_text}
    plan = {"type": "array", "items": action, "maxItems": spec.max_actions}
    return object_schema({**dict.fromkeys(spec.texts, text), spec.plan: plan})


def admits_plan(spec: PlanSpec, text: str) -> bool:
    """Return whether a JSON text, however it is spaced, is a plan of listed actions."""
    try:
        found = msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return False
    if not isinstance(found, dict) or not isinstance(found.get(spec.plan), list):
        return False
    numbers = [one.get(spec.number) if isinstance(one, dict) else None for one in found[spec.plan]]
    return len(numbers) <= spec.max_actions and all(
        type(number) is int and 0 <= number < len(spec.actions) for number in numbers
    )


PROGRAM = "program"
REFUSE = "refuse"


def schema(spec: ProgramSpec) -> dict[str, Any]:
    """Return the schema, names in its `$defs`; ValueError where the spec admits no program."""
    kinds = forms(spec)
    lists = list(dict.fromkeys(one.names for form in kinds for one in form.arguments))
    place_of = {names: f"names{number}" for number, names in enumerate(lists)}
    calls = {
        "type": "array",
        "items": {"anyOf": [one for form in kinds for one in _calls(form, place_of)]},
        "minItems": 1,
        "maxItems": spec.max_calls,
    }
    definitions = {
        place: {"type": "string", "enum": list(names)} for names, place in place_of.items()
    }
    program: dict[str, Any] = calls
    if spec.refusals:
        kinds_of = {"type": "string", "enum": list(dict.fromkeys(spec.refusals))}
        program = {"anyOf": [calls, object_schema({REFUSE: kinds_of})]}
    return {**object_schema({PROGRAM: program}), "$defs": definitions}


def program_text(answer: str) -> str | None:
    r"""Return the program that a JSON answer stands for; None where it is no such answer.

    >>> program_text('{"program": [{"skill": "PutObject", "object": "Mug", "object_2": "Sink"}]}')
    "PutObject(robot, 'Mug', 'Sink')\n"
    """
    try:
        match json.loads(answer):
            case {"program": [*calls], **others} if not others:
                lines = [_line(call) for call in calls]
            case {"program": {"refuse": kind, **rest}, **others} if not (rest or others):
                lines = [f"{RefusedRequest(kind=kind)}\n" if kind in REFUSAL_KINDS else ""]
            case _:
                return None
    except (ValueError, RecursionError):
        return None
    return "".join(line for line in lines if line) if all(lines) else None


def _place(number: int) -> str:
    return "object" if number == 0 else f"object_{number + 1}"


def _calls(form: LineForm, place_of: dict[tuple[str, ...], str]) -> list[dict[str, Any]]:
    """Return a schema for each number of arguments that a line of this form may have."""
    found = []
    for count in range(form.needed, len(form.arguments) + 1):
        fields: dict[str, Any] = {"skill": {"type": "string", "enum": list(form.skills)}}
        objects = 0
        for argument in form.arguments[:count]:
            name = {"$ref": f"#/$defs/{place_of[argument.names]}"}
            if argument.most:
                fields["positions"] = _list(argument, name)
            else:
                fields[_place(objects)] = name
                objects += 1
        found.append(object_schema(fields))
    return found


def _list(argument: Argument, name: dict[str, str]) -> dict[str, Any]:
    return {"type": "array", "items": name, "minItems": 1, "maxItems": argument.most}


def object_schema(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of an object with just these fields, all of them needed."""
    return {
        "type": "object",
        "properties": fields,
        "required": list(fields),
        "additionalProperties": False,
    }


def _line(call: Any) -> str:
    """Return a call as a line of a program, "" for what is no call."""
    if not isinstance(call, dict) or not isinstance(call.get("skill"), str):
        return ""
    positions = call.get("positions", [])
    objects = [call[_place(n)] for n in range(len(call)) if _place(n) in call]
    named = {"skill", *(_place(n) for n in range(len(objects)))}
    if call.keys() - named - {"positions"} or not isinstance(positions, list):
        return ""
    if "positions" in call and not positions:
        return ""
    if not all(isinstance(name, str) for name in (*objects, *positions)):
        return ""
    return f"{SkillCall(skill=call['skill'], objects=tuple(objects), positions=tuple(positions))}\n"
