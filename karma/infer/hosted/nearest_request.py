"""Describe a request that was never recorded by what sets it apart from the nearest one."""

import json
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher, unified_diff
from typing import Any

MAX_LINES = 40
MAX_WIDTH = 160
_COMPARED = 50  # candidates that are compared letter by letter
_LONGEST = 2000  # letters of each that are compared


def describe_miss(
    wanted: Mapping[str, Any],
    recorded: Sequence[tuple[str, Mapping[str, Any]]],
    *,
    scope: str,
    key: str,
) -> str:
    """Return a message with the nearest of (episode, request), and how it differs."""
    asked = f"request {key[:12]} of episode {scope!r} was not recorded"
    if not recorded:
        return f"{asked}: the cassette holds no exchange"
    lines = readable(wanted)
    where, nearest = _nearest(lines, recorded)
    found = readable(nearest)
    if found == lines:
        return f"{asked}: the same was asked in episode {where!r} only"
    names = (f"recorded in {where!r}", "asked now")
    diff = [
        line if len(line) <= MAX_WIDTH else f"{line[: MAX_WIDTH - 3]}..."
        for line in unified_diff(found, lines, *names, lineterm="", n=1)
    ]
    if len(diff) > MAX_LINES:
        diff = [*diff[:MAX_LINES], f"... and {len(diff) - MAX_LINES} lines more"]
    return "\n    ".join([f"{asked}; the nearest differs:", *diff])


def readable(request: Mapping[str, Any]) -> list[str]:
    """Return a request as lines: JSON, but a text of several lines is a line each.

    >>> readable({"model": "m", "prompt": "a" + chr(10) + "b"})
    ['model: "m"', 'prompt: |a', 'prompt: |b']
    """
    return list(_lines("", request))


def _lines(path: str, value: Any) -> list[str]:
    if isinstance(value, Mapping):
        return [ln for k in sorted(value) for ln in _lines(f"{path}.{k}" if path else k, value[k])]
    if isinstance(value, list | tuple) and any(isinstance(v, Mapping) for v in value):
        return [line for n, item in enumerate(value) for line in _lines(f"{path}[{n}]", item)]
    if isinstance(value, str) and "\n" in value:
        return [f"{path}: |{part}" for part in value.removesuffix("\n").split("\n")]
    return [f"{path}: {json.dumps(value, ensure_ascii=False)}"]


def _nearest(
    lines: Sequence[str], recorded: Sequence[tuple[str, Mapping[str, Any]]]
) -> tuple[str, Mapping[str, Any]]:
    """Return the one with most lines in common, then the likest other lines, then the first."""
    mine = set(lines)
    others = [readable(request) for _, request in recorded]
    common = [len(mine & set(other)) for other in others]
    most = max(common)
    alike = [number for number, shared in enumerate(common) if shared == most][:_COMPARED]

    def unlikeness(number: int) -> float:
        theirs = set(others[number])
        left = "\n".join(line for line in lines if line not in theirs)
        right = "\n".join(line for line in others[number] if line not in mine)
        return -SequenceMatcher(None, left[:_LONGEST], right[:_LONGEST], autojunk=False).ratio()

    return recorded[min(alike, key=lambda number: (unlikeness(number), number))]
