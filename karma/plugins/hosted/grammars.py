"""Write the language of a spec as servers take it.

GBNF are llama.cpp's grammars; XGrammar reads them too. For servers that enforce JSON schemas only,
a program is
`{"program": [{"skill": "PutObject", "object": "Mug", "object_2": "Sink"}, ...]}`: a call is an
object with its arguments by kind, in the order in which a line has them. A planner that may refuse
may answer `{"program": {"refuse": "thing"}}`.
"""

import json
import re
from typing import Any

from karma.types.grammars import Argument, LineForm, forms
from karma.types.planning import REFUSAL_KINDS, ProgramSpec, RefusedRequest, SkillCall

_TEXT_OR_CLASS = re.compile(r'("(?:\\.|[^"\\])*")|/((?:\\.|[^/\\])*)/')


def gbnf(grammar: str) -> str:
    r"""Return the grammar of a spec, Lark, in llama.cpp's notation; its root is the rule `root`.

    >>> print(gbnf('start: "go(" NAME ")"\nNAME: /[A-Z]/{1,9} | "a: /b/"'))
    root ::= "go(" NAME ")"
    NAME ::= [A-Z]{1,9} | "a: /b/"
    """
    rules = [line.partition(": ") for line in grammar.splitlines()]
    return "\n".join(
        f"{'root' if name == 'start' else name} ::= {_TEXT_OR_CLASS.sub(_text_or_class, body)}"
        for name, _, body in rules
    )


def _text_or_class(found: re.Match[str]) -> str:
    return found[1] or found[2]


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
