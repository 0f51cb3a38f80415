"""Recognise the programs that a `ProgramSpec` admits: an automaton over bytes.

The language is one to `max_calls` lines, each written as `str(SkillCall)` and ended by a newline.
Names stand in quotes and hold none, so every choice is settled by the bytes read so far: the
automaton is deterministic and nothing is ever taken back. `forms` says the same language in short;
the automaton, and the grammars that servers take (`gbnf`, `regex`, `schema`), are made of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from karma.contracts import ProgramSpec

_MAX_POSITIONS = 100  # entries of one list, as the parser admits


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument:
    """What may stand after a comma: a quoted name, or a list of them in brackets."""

    names: tuple[str, ...]
    most: int = 0  # entries of the list; 0: no list, one name


@dataclass(frozen=True, slots=True, kw_only=True)
class LineForm:
    """Lines of one kind: these skills, and what follows `robot` in them."""

    skills: tuple[str, ...]
    arguments: tuple[Argument, ...]
    needed: int  # how many arguments no line leaves out


def forms(spec: ProgramSpec) -> tuple[LineForm, ...]:
    """Return the kinds of lines that a spec admits, those of equal arguments together.

    Raises:
        ValueError: a name cannot be quoted, a skill is named twice, or no line is possible.
    """
    for name in (*spec.objects, *spec.positions):
        if not name or not name.isprintable() or "'" in name or "\\" in name:
            raise ValueError(f"{name!r} cannot be written as a quoted name")
    if len({skill.name for skill in spec.skills}) < len(spec.skills):
        raise ValueError("two skills have the same name")
    positions = tuple(dict.fromkeys(spec.positions))
    kinds = {
        "object": Argument(names=tuple(dict.fromkeys(spec.objects))),
        "positions": Argument(names=positions, most=min(len(positions), _MAX_POSITIONS)),
    }
    found: dict[tuple[tuple[Argument, ...], int], list[str]] = {}
    for skill in spec.skills:
        arguments = [kinds[kind] for kind in skill.arguments]
        needed = len(arguments) - skill.optional
        possible = next((n for n, one in enumerate(arguments) if not one.names), len(arguments))
        if possible >= needed:
            found.setdefault((tuple(arguments[:possible]), needed), []).append(skill.name)
    if not found or spec.max_calls < 1:
        raise ValueError("this spec admits no program: no skill, no object or no call")
    return tuple(
        LineForm(skills=tuple(skills), arguments=arguments, needed=needed)
        for (arguments, needed), skills in found.items()
    )


class _Frame(NamedTuple):
    """A set of prefix-free words, and the frame that follows each.

    nodes[0] is the root; an edge >= 0 leads to a node, an edge < 0 ends word number ~edge.
    """

    nodes: list[dict[int, int]]
    words: tuple[str, ...]
    follow: tuple[Callable[[], "_Frame"], ...]
    line_start: bool = False


class State(NamedTuple):
    """A place in the language: lines completed, and where in which frame."""

    lines: int
    frame: _Frame
    node: int


class ProgramAutomaton:
    """Recognises prefixes of the programs that a spec admits.

    Raises:
        ValueError: a name cannot be quoted, a skill is named twice, or no line is possible.
    """

    def __init__(self, spec: ProgramSpec) -> None:
        self._max_lines = spec.max_calls
        frame_of = {form: self._after(form) for form in forms(spec)}
        after = {name: frame_of[form] for form in frame_of for name in form.skills}
        names = [skill.name for skill in spec.skills if skill.name in after]
        line = _trie([f"{name}(robot" for name in names])
        follow = tuple(after[name] for name in names)
        self._line = line._replace(follow=follow, line_start=True)

    def start(self) -> State:
        """Return the state before the first character."""
        return State(0, self._line, 0)

    def advance(self, state: State, text: str | bytes) -> State | None:
        """Return the state after `text`, or None when no program goes on like this."""
        lines, frame, node = state
        for byte in text.encode() if isinstance(text, str) else text:
            if node == 0 and frame.line_start and lines == self._max_lines:
                return None
            edge = frame.nodes[node].get(byte)
            if edge is None:
                return None
            if edge >= 0:
                node = edge
                continue
            frame, node = frame.follow[~edge](), 0
            lines += frame.line_start
        return State(lines, frame, node)

    def accepts(self, state: State) -> bool:
        """Return whether the text so far is a whole program."""
        return state.lines > 0 and state.node == 0 and state.frame.line_start

    def next_bytes(self, state: State) -> tuple[int, ...]:
        """Return the bytes that may come next; () after the last possible line."""
        if self.accepts(state) and state.lines == self._max_lines:
            return ()
        return tuple(state.frame.nodes[state.node])

    def random_program(self, generator: np.random.Generator, lines: int) -> str:
        """Return a program of so many lines, each choice made uniformly."""
        text, frame, done = [], self._line, 0
        while done < lines:
            word = int(generator.integers(len(frame.words)))
            text.append(frame.words[word])
            frame = frame.follow[word]()
            done += frame.line_start
        return "".join(text)

    def _after(self, form: LineForm, done: int = 0) -> Callable[[], _Frame]:
        """Return the frame after `done` arguments: end of line, or one argument more."""

        @cache
        def build() -> _Frame:
            words: dict[str, Callable[[], _Frame]] = {}
            if done >= form.needed:
                words[")\n"] = lambda: self._line
            if done < len(form.arguments):
                argument, then = form.arguments[done], self._after(form, done + 1)
                names = _trie([f"{name}'" for name in argument.names])
                if argument.most:
                    words[", ['"] = self._list(names, argument.most, then)
                else:
                    words[", '"] = _followed(names, then)
            return _trie(list(words))._replace(follow=tuple(words.values()))

        return build

    def _list(self, names: _Frame, left: int, then: Callable[[], _Frame]) -> Callable[[], _Frame]:
        """Return the frame of a list's entry, when it may have `left` with this one."""

        @cache
        def build() -> _Frame:
            words = {"]": then}
            if left > 1:
                words[", '"] = self._list(names, left - 1, then)
            after = _trie(list(words))._replace(follow=tuple(words.values()))
            return _followed(names, lambda: after)()

        return build


def _followed(frame: _Frame, then: Callable[[], _Frame]) -> Callable[[], _Frame]:
    """Return `frame` with every word followed by `then`."""
    whole = frame._replace(follow=(then,) * len(frame.words))
    return lambda: whole


def _trie(words: Sequence[str]) -> _Frame:
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
    return _Frame(nodes, tuple(words), ())
