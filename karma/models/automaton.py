"""Recognise the answers that a spec admits: an automaton over bytes.

The language of a `ProgramSpec` is one to `max_calls` lines, each written as `str(SkillCall)`; or
one line that refuses, where the spec has such. An answer may end right after a line's `)`, after
its newline, and after one of `CLOSINGS` on the line below: instruction-tuned models end in all of
these ways. Names stand in quotes and hold none, so every choice is settled by the bytes read so
far: the automaton is deterministic and nothing is ever taken back. `forms` says the same language
in short; the automaton, and the grammars that servers take (`grammars`), are made of it.
A `PlanSpec` admits one JSON text, compact, as its examples are written:

    {"why":"...","executable_plan":[{"action_id":3,"action_name":"find a Mug"},...]}

Its texts are printable ASCII without quotes and backslashes, and of bounded length; a number fixes
its name.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from typing import Any, NamedTuple

import msgspec

from karma.types.planning import AnswerSpec, PlanSpec, ProgramSpec, RefusedRequest

CLOSINGS = ("\n", "```", "#")  # on the line below a call: the program has ended above it
_FAR = 64  # bytes that are looked ahead
_MAX_POSITIONS = 100  # entries of one list, as the parser admits


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
    narrowed = dict(spec.narrowed)
    for skill in spec.skills:
        allowed = narrowed.get(skill.name, ())
        lists = [Argument(names=tuple(dict.fromkeys(names))) for names in allowed]
        arguments = [*lists, *(kinds[kind] for kind in skill.arguments[len(lists) :])]
        needed = len(arguments) - (0 if lists else skill.optional)
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
    return tuple(str(RefusedRequest(kind=kind)) for kind in dict.fromkeys(spec.refusals))


def without_closing(text: str) -> str:
    r"""Return the program of an answer in the language, without what only ended it.

    >>> without_closing("GoToObject(robot, 'Mug')\n```\nThis")
    "GoToObject(robot, 'Mug')\n"
    """
    lines = text.splitlines(keepends=True)
    return "".join(takewhile(lambda line: not line.startswith(CLOSINGS), lines))


_CLOSED = END._replace()  # a frame of its own: nothing of the program follows
_REFUSED = trie(["\n"])._replace(follow=(lambda: END,), ends=True)


class State(NamedTuple):
    """A place in the language: lines completed, and where in which frame."""

    lines: int
    frame: Frame
    node: int


class ProgramAutomaton:
    """Recognises prefixes of the programs, or of the plan in JSON, that a spec admits.

    ValueError as by `forms`.
    """

    def __init__(self, spec: AnswerSpec) -> None:
        self._max_lines, self._calls = 0, frozenset[int]()
        if isinstance(spec, PlanSpec):
            self._start = self._line = plan_frame(spec)
            return
        self._max_lines = spec.max_calls
        self._calls = frozenset(skill.name.encode()[0] for skill in spec.skills)
        begins = {
            f"{name}(robot": self._after(form) for form in forms(spec) for name in form.skills
        }
        order = [f"{skill.name}(robot" for skill in spec.skills]
        begins = {word: begins[word] for word in order if word in begins}
        refusals = {line: lambda: _REFUSED for line in refusal_lines(spec)}
        self._start = choice({**begins, **refusals})
        closings = {closing: lambda: _CLOSED for closing in CLOSINGS}
        self._line = choice({**begins, **closings})._replace(line_start=True)

    def start(self) -> State:
        """Return the state before the first character."""
        return State(0, self._start, 0)

    def advance(self, state: State, text: str | bytes, *, closing: bool = False) -> State | None:
        """Return the state after `text`, or None when no program goes on like this.

        `closing`: anything may follow what closes a program, since a token may hold both.
        """
        lines, frame, node = state
        for byte in text.encode() if isinstance(text, str) else text:
            if closing and frame is _CLOSED:
                break
            if frame.line_start and node == 0 and lines == self._max_lines and byte in self._calls:
                return None
            edge = frame.nodes[node].get(byte)
            if edge is None:
                return None
            if edge >= 0:
                node = edge
                continue
            frame, node = frame.follow[~edge](), 0
            lines += frame.line_end
        return State(lines, frame, node)

    def accepts(self, state: State) -> bool:
        """Return whether the text so far is a whole answer."""
        frame = state.frame
        return frame.ends or (state.node == 0 and (frame.line_end or frame.line_start))

    def next_bytes(self, state: State) -> tuple[int, ...]:
        """Return the bytes that may come next; () where nothing may."""
        found = state.frame.nodes[state.node]
        if state.frame.line_start and state.node == 0 and state.lines == self._max_lines:
            return tuple(byte for byte in found if byte not in self._calls)
        return tuple(found)

    def expected(self, state: State) -> bytes:
        """Return the bytes that follow, up to a choice, if the answer does not end before."""
        found = bytearray()
        while len(found) < _FAR and len(coming := self.next_bytes(state)) == 1:
            after = self.advance(state, bytes(coming))
            if after is None:
                break
            found += bytes(coming)
            state = after
        return bytes(found)

    def _after(self, form: LineForm, done: int = 0) -> Callable[[], Frame]:
        """Return the frame after `done` arguments: end of line, or one argument more."""

        @cache
        def build() -> Frame:
            words: dict[str, Callable[[], Frame]] = {}
            if done >= form.needed:
                end = trie(["\n"])._replace(follow=(lambda: self._line,), line_end=True)
                words[")"] = lambda: end
            if done < len(form.arguments):
                argument, then = form.arguments[done], self._after(form, done + 1)
                names = trie([f"{name}'" for name in argument.names])._replace(names=True)
                if argument.most:
                    words[", ['"] = self._list(names, argument.most, then)
                else:
                    words[", '"] = followed(names, then)
            return choice(words)

        return build

    def _list(self, names: Frame, left: int, then: Callable[[], Frame]) -> Callable[[], Frame]:
        """Return the frame of a list's entry, when it may have `left` with this one."""

        @cache
        def build() -> Frame:
            words = {"]": then}
            if left > 1:
                words[", '"] = self._list(names, left - 1, then)
            after = choice(words)
            return followed(names, lambda: after)()

        return build


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
