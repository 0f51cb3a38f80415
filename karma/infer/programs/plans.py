"""The language of plans in JSON: as the frames of an automaton.

    {"why":"...","executable_plan":[{"action_id":3,"action_name":"find a Mug"},...]}

Compact, as its examples are written. Texts are printable ASCII without quotes and backslashes, and
of bounded length; a number fixes its name.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import msgspec

from karma.contracts import PlanSpec
from karma.infer.programs.frames import END, Frame, trie

_LETTERS = "".join(chr(code) for code in range(0x20, 0x7F) if chr(code) not in '"\\')


def plan_frame(spec: PlanSpec) -> Frame:
    """Return where an answer begins.

    Raises:
        ValueError: there is no action to name.
    """
    frame = _list(spec)
    for key in reversed(spec.texts):
        frame = _text(spec, key, frame)
    return _words({"{": lambda: frame})


def _text(spec: PlanSpec, key: str, then: Frame) -> Frame:
    """Return the frame of a key and its text."""
    letters = {letter: letter for letter in _LETTERS}
    close = trie(['",'])._replace(follow=(lambda: then,))
    any_letter = trie([*letters, '",'])

    @cache
    def rest(left: int) -> Frame:
        if not left:
            return close
        more: Callable[[], Frame] = lambda: rest(left - 1)  # noqa: E731  one for all letters
        return any_letter._replace(follow=(*(more for _ in letters), lambda: then))

    return _words({f'{as_json(key)}:"': lambda: rest(spec.max_text)})


def _list(spec: PlanSpec) -> Frame:
    """Return the frame of the list of actions, the last key."""
    items = items_of(spec)
    first, more = trie([*items, "]}"]), trie(items)

    @cache
    def item(left: int) -> Frame:
        again: Callable[[], Frame] = lambda: after(left - 1)  # noqa: E731
        follow = tuple(again for _ in items)
        if left == spec.max_actions:
            return first._replace(follow=(*follow, lambda: END))
        return more._replace(follow=follow)

    @cache
    def after(left: int) -> Frame:
        words: dict[str, Callable[[], Frame]] = {"]}": lambda: END}
        if left:
            words[","] = lambda: item(left)
        return _words(words)

    return _words({f"{as_json(spec.plan)}:[": lambda: item(spec.max_actions)})


def items_of(spec: PlanSpec) -> list[str]:
    """Return every action as it stands in a plan; ValueError where a spec admits none."""
    if not spec.actions or spec.max_actions < 1 or spec.max_text < 0:
        raise ValueError("this spec admits no plan: no action, or a bound below nothing")
    return [as_json({spec.number: n, spec.name: name}) for n, name in enumerate(spec.actions)]


def _words(words: Mapping[str, Callable[[], Frame]]) -> Frame:
    return trie(list(words))._replace(follow=tuple(words.values()))


def as_json(value: Any) -> str:
    """Return a value as it stands in a plan."""
    return msgspec.json.encode(value).decode()
