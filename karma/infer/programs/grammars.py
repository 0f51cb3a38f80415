"""Write the language of a spec, of programs or of plans, as servers take it: GBNF or regex.

GBNF are llama.cpp's grammars; XGrammar reads them too. The regular expressions match whole answers,
in what all dialects share.
"""

from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from karma.contracts import PlanSpec, ProgramSpec
from karma.infer.programs.automaton import CLOSINGS, Argument, LineForm, forms, refusal_lines
from karma.infer.programs.frames import as_json, items_of
from karma.infer.programs.schema import object_schema

_SIGNS = frozenset(".^$*+?{}[]()|\\")
_CLASS = r"[ !#-\[\]-~]"  # printable ASCII without quotes and backslashes


def gbnf(spec: ProgramSpec) -> str:
    r"""Return the grammar of programs, one rule a line; its root is the rule `root`.

    Raises:
        ValueError: the spec admits no program.

    >>> from karma.contracts import Skill
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
        return " ".join(_call(form, before, argument, literal(")"), " "))

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


def regex(spec: ProgramSpec) -> str:
    r"""Return the expression that matches whole programs.

    Raises:
        ValueError: the spec admits no program.

    >>> from karma.contracts import Skill
    >>> go = Skill(name="GoToObject", arguments=("object",))
    >>> print(regex(ProgramSpec(skills=(go,), objects=("Mug", "Sink"), max_calls=1)))
    ((GoToObject)\(robot, '(Mug|Sink)'\))(\n(\n|```|#)?)?
    """

    def any_of(words: Sequence[str]) -> str:
        return f"({'|'.join(map(escaped, words))})"

    def argument(one: Argument) -> str:
        name = f"'{any_of(one.names)}'"
        if not one.most:
            return f", {name}"
        return rf", \[{name}(, {name}){{0,{one.most - 1}}}\]"

    def line(form: LineForm) -> str:
        return "".join(_call(form, [any_of(form.skills), r"\(robot"], argument, r"\)", ""))

    lines = f"({'|'.join(map(line, forms(spec)))})"
    more = rf"(\n{lines}){{0,{spec.max_calls - 1}}}" if spec.max_calls > 1 else ""
    closing = any_of(CLOSINGS).replace("\n", r"\n")
    program = rf"{lines}{more}(\n{closing}?)?"
    refusals = [rf"{escaped(line)}\n?" for line in refusal_lines(spec)]
    return f"({'|'.join([program, *refusals])})" if refusals else program


def _call(
    form: LineForm, before: list[str], argument: Callable[[Argument], str], end: str, between: str
) -> list[str]:
    """Return the parts of a call; an argument that may be left out holds those behind it."""
    rest: list[str] = []
    for one in reversed(form.arguments[form.needed :]):
        rest = [f"({between.join([argument(one), *rest])})?"]
    return [*before, *map(argument, form.arguments[: form.needed]), *rest, end]


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


def escaped(text: str) -> str:
    r"""Return an expression that matches the text alone.

    >>> print(escaped("Apple|1.5"))
    Apple\|1\.5
    """
    return "".join(f"\\{sign}" if sign in _SIGNS else sign for sign in text)


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


def plan_regex(spec: PlanSpec) -> str:
    """Return the expression that matches whole plans; errors as those of `plan_frame`."""
    items = f"({'|'.join(map(escaped, items_of(spec)))})"
    texts = "".join(
        f'{escaped(as_json(key))}:"{_CLASS}{{0,{spec.max_text}}}",' for key in spec.texts
    )
    many = f"({items}(,{items}){{0,{spec.max_actions - 1}}})?"
    return rf"\{{{texts}{escaped(as_json(spec.plan))}:\[{many}\]\}}"


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
