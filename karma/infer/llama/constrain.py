"""Constrain decoding to programs: an automaton over bytes, and the choice of tokens by it.

The language of a `ProgramSpec` is one to `max_calls` lines, each written as `str(SkillCall)` and
ended by a newline. Names stand in quotes and hold none, so every choice is settled by the bytes
read so far: the automaton is deterministic and nothing is ever taken back.

Tokens are chosen by sample-then-check: the best token first, and only if it is refused the next
best, in exact order. The result equals masking the whole vocabulary, at the price of one check.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.contracts import ProgramSpec, SkillSignature
from karma.errors import ModelError

Logits = NDArray[np.float32]

_MAX_POSITIONS = 100  # entries of one list, as the parser admits
_CHUNK = 64


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
        for name in (*spec.objects, *spec.positions):
            if not name or not name.isprintable() or "'" in name or "\\" in name:
                raise ValueError(f"{name!r} cannot be written as a quoted name")
        if len({skill.name for skill in spec.skills}) < len(spec.skills):
            raise ValueError("two skills have the same name")
        self._max_lines = spec.max_calls
        self._objects = _trie([f"{name}'" for name in dict.fromkeys(spec.objects)])
        positions = tuple(dict.fromkeys(spec.positions))
        self._positions = _trie([f"{name}'" for name in positions])
        self._most_positions = min(len(positions), _MAX_POSITIONS)
        skills = [skill for skill in spec.skills if self._possible(skill)]
        if not skills or spec.max_calls < 1:
            raise ValueError("this spec admits no program: no skill, no object or no call")
        self._line = self._line_frame(skills)

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

    def _possible(self, skill: SkillSignature) -> bool:
        needed = skill.arguments[: len(skill.arguments) - skill.optional]
        return all(self._has_names(kind) for kind in needed)

    def _has_names(self, kind: str) -> bool:
        return bool((self._objects if kind == "object" else self._positions).words)

    def _line_frame(self, skills: Sequence[SkillSignature]) -> _Frame:
        frame = _trie([f"{skill.name}(robot" for skill in skills])
        follow = tuple(self._after(skill) for skill in skills)
        return frame._replace(follow=follow, line_start=True)

    def _after(self, skill: SkillSignature, done: int = 0) -> Callable[[], _Frame]:
        """Return the frame after `done` arguments: end of line, or one argument more."""

        @cache
        def build() -> _Frame:
            words: dict[str, Callable[[], _Frame]] = {}
            if done >= len(skill.arguments) - skill.optional:
                words[")\n"] = lambda: self._line
            if done < len(skill.arguments) and self._has_names(skill.arguments[done]):
                then = self._after(skill, done + 1)
                if skill.arguments[done] == "object":
                    words[", '"] = _followed(self._objects, then)
                else:
                    words[", ['"] = self._list(then, 1)
            return _trie(list(words))._replace(follow=tuple(words.values()))

        return build

    def _list(self, then: Callable[[], _Frame], number: int) -> Callable[[], _Frame]:
        """Return the frame of the list's entry `number`, from 1."""

        @cache
        def build() -> _Frame:
            words = {"]": then}
            if number < self._most_positions:
                words[", '"] = self._list(then, number + 1)
            after = _trie(list(words))._replace(follow=tuple(words.values()))
            return _followed(self._positions, lambda: after)()

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


class TokenTable:
    """A vocabulary as bytes.

    Args:
        pieces: what each token id appends to the text; b"" for control tokens.
        end_tokens: ids that end an answer.
    """

    def __init__(self, pieces: Sequence[bytes], end_tokens: Sequence[int]) -> None:
        self.pieces = tuple(pieces)
        self.end_tokens = frozenset(end_tokens)
        self._first = np.array([piece[0] if piece else 256 for piece in pieces], np.int16)
        self._is_end = np.zeros(len(pieces), bool)
        self._is_end[list(end_tokens)] = True

    def beginning(self, first_bytes: Sequence[int], *, end: bool) -> NDArray[np.intp]:
        """Return the ids that begin with one of the bytes, and the end tokens if `end`."""
        wanted = np.zeros(257, bool)
        wanted[list(first_bytes)] = True
        chosen = wanted[self._first] & ~self._is_end
        return np.flatnonzero(chosen | self._is_end if end else chosen)


class ChosenToken(NamedTuple):
    """A token, and the state it leads to; None after an end token."""

    token: int
    state: State | None


def best_token(scores: Logits) -> int:
    """Return the token of the highest score, the lowest id of equals.

    Raises:
        ModelError: that score is not a finite number.
    """
    top = int(np.argmax(scores))
    if not np.isfinite(scores[top]):
        raise ModelError(f"the best score of a token is {scores[top]}: damaged weights")
    return top


def choose_token(
    scores: Logits, automaton: ProgramAutomaton, state: State, table: TokenTable
) -> ChosenToken:
    """Return the best token that keeps the program alive, lowest id first among equals.

    Args:
        scores: one per token, e.g. logits, or logits with `gumbel` noise to sample.
        automaton: the language.
        state: where the text stands; must not be dead.
        table: the vocabulary; end tokens are admitted where the automaton accepts.

    Raises:
        ModelError: no token can continue, or no score is a finite number.
    """
    ends = automaton.accepts(state)

    def admitted(token: int) -> ChosenToken | None:
        if token in table.end_tokens:
            return ChosenToken(token, None) if ends else None
        piece = table.pieces[token]
        after = automaton.advance(state, piece) if piece else None
        return None if after is None else ChosenToken(token, after)

    best = admitted(best_token(scores))
    if best is not None:
        return best
    ids = table.beginning(automaton.next_bytes(state), end=ends)
    for rank in descending(scores[ids]):
        choice = admitted(int(ids[rank]))
        if choice is not None:
            return choice
    raise ModelError("no token of this model continues the program (damaged weights or vocabulary)")


def descending(scores: Logits) -> Iterator[int]:
    """Yield the indices of finite scores from high to low, equal ones by index, sorting lazily."""
    count, size, upper = len(scores), _CHUNK, np.float32(np.inf)
    while True:
        rest = size >= count
        lower = np.float32(-np.inf) if rest else np.partition(scores, count - size)[count - size]
        inside = (scores > lower) if rest else (scores >= lower)
        ids = np.flatnonzero(inside & (scores < upper))
        yield from ids[np.argsort(-scores[ids], kind="stable")].tolist()
        if rest:
            return
        size, upper = size * 8, lower


def gumbel(logits: Logits, temperature: float, generator: np.random.Generator) -> Logits:
    """Return scores whose best index is a sample of softmax(logits / temperature).

    The best index among any subset is a sample of the distribution renormalised over it, so
    checking after the noise is exact.
    """
    noise = generator.standard_exponential(len(logits), dtype=np.float32)
    noise = np.maximum(noise, np.finfo(np.float32).tiny)
    return np.asarray(logits / np.float32(temperature) - np.log(noise), np.float32)
