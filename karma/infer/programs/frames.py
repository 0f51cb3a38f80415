"""Sets of words that follow each other, of which automata over bytes are made; and plans in JSON.

    {"why":"...","executable_plan":[{"action_id":3,"action_name":"find a Mug"},...]}

Compact, as its examples are written. Texts are printable ASCII without quotes and backslashes, and
of bounded length; a number fixes its name.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import msgspec

from karma.contracts import PlanSpec


class Frame(NamedTuple):
    """A set of prefix-free words, and the frame that follows each.

    nodes[0] is the root; an edge >= 0 leads to a node, an edge < 0 ends word number ~edge.
    """

    nodes: list[dict[int, int]]
    words: tuple[str, ...]
    follow: tuple[Callable[[], "Frame"], ...]
    names: bool = False  # its words are names, with the quote that ends them
    line_start: bool = False
    line_end: bool = False  # a call is whole, its newline may follow
    ends: bool = False  # nothing has to follow


def followed(frame: Frame, then: Callable[[], Frame]) -> Callable[[], Frame]:
    """Return `frame` with every word followed by `then`."""
    whole = frame._replace(follow=(then,) * len(frame.words))
    return lambda: whole


def trie(words: Sequence[str]) -> Frame:
    """Build the frame of prefix-free words, nothing following yet."""
    nodes: list[dict[int, int]] = [{}]
    for number, word in enumerate(words):
        *inner, last = word.encode()
        node = 0
        for byte in inner:
            if byte not in nodes[node]:
                nodes[node][byte] = len(nodes)
                nodes.append({})
            node = nodes[node][byte]
        nodes[node][last] = ~number
    return Frame(nodes, tuple(words), ())


def choice(words: Mapping[str, Callable[[], Frame]]) -> Frame:
    """Return the frame of words, and of what follows each."""
    return trie(list(words))._replace(follow=tuple(words.values()))


END = trie([])._replace(ends=True)


_LETTERS = "".join(chr(code) for code in range(0x20, 0x7F) if chr(code) not in '"\\')


def plan_frame(spec: PlanSpec) -> Frame:
    """Return where an answer begins; ValueError where there is no action to name."""
    frame = _list(spec)
    for key in reversed(spec.texts):
        frame = _text(spec, key, frame)
    return choice({"{": lambda: frame})


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

    return choice({f'{as_json(key)}:"': lambda: rest(spec.max_text)})


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
        return choice(words)

    return choice({f"{as_json(spec.plan)}:[": lambda: item(spec.max_actions)})


def items_of(spec: PlanSpec) -> list[str]:
    """Return every action as it stands in a plan; ValueError where a spec admits none."""
    if not spec.actions or spec.max_actions < 1 or spec.max_text < 0:
        raise ValueError("this spec admits no plan: no action, or a bound below nothing")
    return [as_json({spec.number: n, spec.name: name}) for n, name in enumerate(spec.actions)]


def as_json(value: Any) -> str:
    """Return a value as it stands in a plan."""
    return msgspec.json.encode(value).decode()
