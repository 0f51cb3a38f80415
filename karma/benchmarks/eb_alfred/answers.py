"""Read a planner's answer: a JSON object with numbers of actions; parsed, never executed.

What is wrong with JSON is mended within bounds: prose and fences around it, commas before a closing
bracket, brackets that are missing at its end because the answer was cut off.
"""

import re
from dataclasses import dataclass
from typing import Any

import msgspec

LONGEST = 200_000  # characters that are looked at
PLAN, NUMBER = "executable_plan", "action_id"
_DIGITS = re.compile(r"\d{1,6}")
_COMMA = re.compile(r",(\s*[\]}])")
_CLOSES = {"{": "}", "[": "]"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanReading:
    """What an answer says."""

    plan: tuple[int, ...] = ()
    error: str = ""  # why it is of no use; "" with an empty plan: the planner gives up
    mended: bool = False
    no_json: bool = False  # no JSON, or not of the form that was asked for


def read_answer(text: str, actions: int, *, mend: bool = True) -> PlanReading:
    """Return the plan of an answer, cut before the first number that no action has.

    Args:
        text: as the planner gave it.
        actions: how many there are.
        mend: whether broken JSON is mended.
    """
    found, mended = _parsed(text, mend=mend)
    if not isinstance(found, dict) or not isinstance(found.get(PLAN), list):
        what = "there is no JSON object" if not isinstance(found, dict) else f"no list {PLAN!r}"
        return PlanReading(error=f"{what} in the answer", no_json=True)
    plan: list[int] = []
    for place, item in enumerate(found[PLAN]):
        number = _number(item, mend=mend)
        if number is None:
            error = f"{PLAN}[{place}] has no whole number {NUMBER!r}"
            return PlanReading(error=error, no_json=True)
        if not 0 <= number < actions:
            if plan:
                break
            return PlanReading(error=f"there is no action {number}; the last is {actions - 1}")
        plan.append(number)
    return PlanReading(plan=tuple(plan), mended=mended)


def _number(item: Any, *, mend: bool) -> int | None:
    said = item.get(NUMBER) if isinstance(item, dict) else item if mend else None
    if mend and isinstance(said, str) and _DIGITS.fullmatch(said.strip()):
        said = int(said)
    return said if isinstance(said, int) and not isinstance(said, bool) else None


def _parsed(text: str, *, mend: bool) -> tuple[Any, bool]:
    """Return the JSON of an answer, and whether it had to be mended; None where there is none."""
    text = text[:LONGEST]
    whole = _decoded(text.strip())
    if whole is not None or not mend:
        return whole, False
    begin = text.find("{")
    if begin < 0:
        return None, False
    body = text[begin:]
    for attempt in (body[: body.rfind("}") + 1], _COMMA.sub(r"\1", body[: body.rfind("}") + 1])):
        found = _decoded(attempt)
        if found is not None:
            return found, True
    return _decoded(_COMMA.sub(r"\1", _closed(body))), True


def _decoded(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


def _closed(text: str) -> str:
    """Return a cut-off text up to its last whole item, with the brackets that are missing."""
    open_, ends, inside, skip = [], [(0, "")], False, False
    for place, char in enumerate(text):
        if skip:
            skip = False
        elif inside:
            skip, inside = char == "\\", char != '"'
        elif char == '"':
            inside = True
        elif char in _CLOSES:
            open_.append(_CLOSES[char])
        elif open_ and char == open_[-1]:
            open_.pop()
            ends.append((place + 1, "".join(reversed(open_))))
            if not open_:
                break
    end, missing = ends[-1]
    return text[:end] + missing
