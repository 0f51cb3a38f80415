"""Say which plans in JSON a planner may answer, as a grammar and as a JSON schema.

A plan is compact JSON, as its examples are written:

    {"why":"...","executable_plan":[{"action_id":3,"action_name":"find a Mug"},...]}

Its texts are printable ASCII without quotes and backslashes, and of bounded length; a number fixes
its name.
"""

from dataclasses import dataclass
from typing import Any

import msgspec

from karma.types.grammars import any_of, literal

_LETTER = r"/[ !#-\[\]-~]/"  # printable ASCII without quotes and backslashes


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanSpec:
    """What a plan in JSON may say: short texts by key, then numbers and names of listed actions."""

    texts: tuple[str, ...]  # keys, in their order
    plan: str  # key of the list of actions
    number: str  # key of an action's number
    name: str  # key of its name
    actions: tuple[str, ...]  # names, by number
    max_text: int = 300  # characters of each text
    max_actions: int = 20

    @property
    def grammar(self) -> str:
        """Return the grammar of plans; ValueError if the spec admits none."""
        if not self.actions or self.max_actions < 1 or self.max_text < 0:
            raise ValueError("this spec admits no plan: no action, or a bound below nothing")
        letters = f"{_LETTER}{{0,{self.max_text}}} " if self.max_text else ""
        rules = {
            f"TEXT{n}": f"""{literal(_as_json(key) + ':"')} {letters}{literal('",')}"""
            for n, key in enumerate(self.texts)
        }
        items = [_as_json({self.number: n, self.name: name}) for n, name in enumerate(self.actions)]
        rules["ITEM"] = any_of(items)
        more = f' ("," ITEM){{0,{self.max_actions - 1}}}' if self.max_actions > 1 else ""
        texts = " ".join(name for name in rules if name != "ITEM")
        begin = literal(_as_json(self.plan) + ":[")
        start = f'"{{" {texts} {begin} (ITEM{more})? "]}}"'
        return "\n".join(f"{name}: {body}" for name, body in {"start": start, **rules}.items())

    @property
    def schema(self) -> dict[str, Any]:
        """Return the JSON schema of plans, for servers that take no grammar."""
        most = len(self.actions) - 1
        action = _object(
            {
                self.number: {"type": "integer", "minimum": 0, "maximum": most},
                self.name: {"type": "string"},
            }
        )
        text = {"type": "string", "maxLength": self.max_text}
        plan = {"type": "array", "items": action, "maxItems": self.max_actions}
        return _object({**dict.fromkeys(self.texts, text), self.plan: plan})

    def admits(self, text: str) -> bool:
        """Return whether a JSON text, however it is spaced, is a plan of listed actions."""
        try:
            found = msgspec.json.decode(text)
        except (msgspec.DecodeError, UnicodeError, RecursionError):
            return False
        if not isinstance(found, dict) or not isinstance(found.get(self.plan), list):
            return False
        actions = found[self.plan]
        numbers = [a.get(self.number) if isinstance(a, dict) else None for a in actions]
        return len(numbers) <= self.max_actions and all(
            type(number) is int and 0 <= number < len(self.actions) for number in numbers
        )


def _as_json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _object(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": fields,
        "required": list(fields),
        "additionalProperties": False,
    }
