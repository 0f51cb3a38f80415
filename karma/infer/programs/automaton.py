"""Recognise the answers that a spec admits: an automaton over bytes.

The language of a `ProgramSpec` is one to `max_calls` lines, each written as `str(SkillCall)` and
ended by a newline; or one line that refuses, where the spec has such. Names stand in quotes and
hold none, so every choice is settled by the bytes read so far: the automaton is deterministic and
nothing is ever taken back. `forms` says the same language in short; the automaton, and the grammars
that servers take (`gbnf`, `regex`, `schema`), are made of it. A `PlanSpec` admits one JSON text,
see `plans`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from karma.contracts import AnswerSpec, PlanSpec, ProgramSpec, RefusedRequest
from karma.infer.programs.frames import END, Frame, followed, trie
from karma.infer.programs.plans import plan_frame

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


def refusal_lines(spec: ProgramSpec) -> tuple[str, ...]:
    """Return the lines of which one may stand in place of a program."""
    return tuple(f"{RefusedRequest(kind=kind)}\n" for kind in dict.fromkeys(spec.refusals))


class State(NamedTuple):
    """A place in the language: lines completed, and where in which frame."""

    lines: int
    frame: Frame
    node: int


class ProgramAutomaton:
    """Recognises prefixes of the programs, or of the plan in JSON, that a spec admits.

    Raises:
        ValueError: a name cannot be quoted, a skill is named twice, or no line is possible.
    """

    def __init__(self, spec: AnswerSpec) -> None:
        self._max_lines = 0
        self._jumps = isinstance(spec, PlanSpec)  # programs are decoded token by token
        if isinstance(spec, PlanSpec):
            self._start = self._line = plan_frame(spec)
            return
        self._max_lines = spec.max_calls
        frame_of = {form: self._after(form) for form in forms(spec)}
        after = {name: frame_of[form] for form in frame_of for name in form.skills}
        names = [skill.name for skill in spec.skills if skill.name in after]
        line = trie([f"{name}(robot" for name in names])
        follow = tuple(after[name] for name in names)
        self._line = line._replace(follow=follow, line_start=True)
        refusals = refusal_lines(spec)
        start = trie([*line.words, *refusals])
        self._start = start._replace(follow=(*follow, *((lambda: END,) * len(refusals))))

    def start(self) -> State:
        """Return the state before the first character."""
        return State(0, self._start, 0)

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
        """Return whether the text so far is a whole answer."""
        frame = state.frame
        return frame.ends or (state.lines > 0 and state.node == 0 and frame.line_start)

    def next_bytes(self, state: State) -> tuple[int, ...]:
        """Return the bytes that may come next; () after the last possible line."""
        if self.accepts(state) and state.lines == self._max_lines:
            return ()
        return tuple(state.frame.nodes[state.node])

    def forced(self, state: State) -> bytes:
        """Return the bytes of a plan that have to come next, up to a choice or the end."""
        found = bytearray()
        while (
            self._jumps and not self.accepts(state) and len(coming := self.next_bytes(state)) == 1
        ):
            found += bytes(coming)
            after = self.advance(state, bytes(coming))
            if after is None:
                break
            state = after
        return bytes(found)

    def random_program(self, generator: np.random.Generator, lines: int) -> str:
        """Return a program of so many lines, or a refusal, each choice made uniformly."""
        text, frame, done = [], self._start, 0
        while done < lines and not frame.ends:
            word = int(generator.integers(len(frame.words)))
            text.append(frame.words[word])
            frame = frame.follow[word]()
            done += frame.line_start
        return "".join(text)

    def _after(self, form: LineForm, done: int = 0) -> Callable[[], Frame]:
        """Return the frame after `done` arguments: end of line, or one argument more."""

        @cache
        def build() -> Frame:
            words: dict[str, Callable[[], Frame]] = {}
            if done >= form.needed:
                words[")\n"] = lambda: self._line
            if done < len(form.arguments):
                argument, then = form.arguments[done], self._after(form, done + 1)
                names = trie([f"{name}'" for name in argument.names])
                if argument.most:
                    words[", ['"] = self._list(names, argument.most, then)
                else:
                    words[", '"] = followed(names, then)
            return trie(list(words))._replace(follow=tuple(words.values()))

        return build

    def _list(self, names: Frame, left: int, then: Callable[[], Frame]) -> Callable[[], Frame]:
        """Return the frame of a list's entry, when it may have `left` with this one."""

        @cache
        def build() -> Frame:
            words = {"]": then}
            if left > 1:
                words[", '"] = self._list(names, left - 1, then)
            after = trie(list(words))._replace(follow=tuple(words.values()))
            return followed(names, lambda: after)()

        return build
