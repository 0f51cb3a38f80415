"""Read a planner's answer: a JSON object with numbers of actions; parsed, never executed.

What is wrong with JSON is mended within bounds: only the list of the plan is looked for, so nothing
before it matters; lines and tabs in texts, quotes and constants of Python, comments, dots for what
was left out, commas before a closing bracket, and brackets that are missing since it was cut off.
"""

import ast
import json
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import msgspec

LONGEST = 200_000  # characters that are looked at
PLAN, NUMBER = "executable_plan", "action_id"
_DIGITS = re.compile(r"\d{1,6}")
_BEGINS = (
    re.compile(rf"{PLAN}\W{{0,3}}[:=]\s*(?=[\[{{])"),
    re.compile(rf"(?=\[\s*\{{\W{{0,3}}{NUMBER})"),
)
_COMMENT = re.compile(r"(?<=[\s,\]}])(?://|#)[^\n\"]*")
_COMMA = re.compile(r",(?:\s*(?:\.\.\.|…),?)?(\s*[\]}])")
_QUOTES = str.maketrans("“”„‟", '""""')
_CLOSES = {"{": "}", "[": "]"}
_TRIES = 20  # beginnings of a list, and ends of each


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
        mended |= not isinstance(_said(item), int)
    return PlanReading(plan=tuple(plan), mended=mended)


def _said(item: Any) -> Any:
    return item.get(NUMBER) if isinstance(item, dict) else item


def _number(item: Any, *, mend: bool) -> int | None:
    said = _said(item) if mend or isinstance(item, dict) else None
    if mend and isinstance(said, str) and _DIGITS.fullmatch(said.strip()):
        said = int(said)
    if mend and isinstance(said, float) and said.is_integer():
        said = int(said)
    return said if isinstance(said, int) and not isinstance(said, bool) else None


def _parsed(text: str, *, mend: bool) -> tuple[Any, bool]:
    """Return the JSON of an answer, and whether it had to be mended; None where there is none."""
    text = text[:LONGEST]
    whole = _decoded(text.strip())
    if not mend or (isinstance(whole, dict) and isinstance(whole.get(PLAN), list)):
        return whole, False
    if isinstance(whole, str):  # JSON as a text in JSON
        return _parsed(whole, mend=False)[0], True
    plans = [
        plan
        for begins in _BEGINS
        for match in islice(begins.finditer(text), _TRIES)
        if (plan := _list(text[match.end() :])) is not None
    ]
    plan = next(filter(None, plans), next(iter(plans), None))
    return (whole, False) if plan is None else ({PLAN: plan}, True)


def _list(text: str) -> list[Any] | None:
    """Return the list that a text begins with, up to its last whole item; None for none at all."""
    text = _COMMENT.sub("", text).translate(_QUOTES)
    for body in islice(_closed(text), _TRIES):
        found = _read(_COMMA.sub(r"\1", body))
        items = [found] if isinstance(found, dict) else found
        if isinstance(items, list) and ... not in items:
            return items
    return None


def _read(text: str) -> Any:
    """Return what JSON, or a literal of Python, says; None where it is neither."""
    try:
        return json.loads(text, strict=False)
    except (ValueError, RecursionError):
        pass
    try:
        with warnings.catch_warnings(action="ignore"):
            return ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError, TypeError):
        return None


def _decoded(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


def _closed(text: str) -> Iterator[str]:
    """Yield the first value of a text, whole, then up to its items, the last one first.

    Brackets that are missing at an end are put there.
    """
    open_, ends, inside, skip = [], [], False, False
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
    for end, missing in reversed(ends):
        yield text[:end] + missing
