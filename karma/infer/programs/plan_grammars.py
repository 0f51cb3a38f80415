"""Write the language of plans as GBNF, regular expression or JSON schema, for servers."""

from typing import Any

import msgspec

from karma.contracts import PlanSpec
from karma.infer.programs.gbnf import literal
from karma.infer.programs.plans import as_json, items_of
from karma.infer.programs.regex import escaped

_CLASS = r"[ !#-\[\]-~]"  # printable ASCII without quotes and backslashes


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
    action = _object(
        {
            spec.number: {"type": "integer", "minimum": 0, "maximum": len(spec.actions) - 1},
            spec.name: {"type": "string"},
        }
    )
    text = {"type": "string", "maxLength": spec.max_text}
    plan = {"type": "array", "items": action, "maxItems": spec.max_actions}
    return _object({**dict.fromkeys(spec.texts, text), spec.plan: plan})


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


def _object(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": fields,
        "required": list(fields),
        "additionalProperties": False,
    }
