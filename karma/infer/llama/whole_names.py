"""Choose a name as a whole where its first token has led astray.

A grammar lets a model begin a name and then denies it the rest: who would say `Desk` in a room
without one has said "Des", and all that is left is `DeskLamp`. So where the token that the model
wants most may not follow inside a name, the name is taken back, and the likeliest of all names that
may stand there is found: best first, by the sum of their tokens' log-probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from karma.infer.choosing import path_to, trie_of
from karma.infer.llama.answer import CertaintyLog
from karma.infer.llama.constrain import Logits, best_token
from karma.infer.llama.gguf_model import GgufModel
from karma.infer.programs.automaton import ProgramAutomaton, State


@dataclass(frozen=True, slots=True)
class NameBegun:
    """Where an answer stood before a name."""

    pieces: int  # of the answer, before it
    state: State
    decoded: int  # tokens in the cache, prompt included
    logits: Logits


class NameWatch:
    """Sees that names are chosen as a whole while an answer is decoded behind its prompt."""

    def __init__(self, model: GgufModel, automaton: ProgramAutomaton, log: CertaintyLog) -> None:
        self._model, self._automaton, self._log = model, automaton, log
        self._begun: NameBegun | None = None

    def seen(self, state: State, pieces: list[bytes]) -> State | None:
        """Return where the answer stands, a name that led astray replaced, in `pieces` too."""
        if not state.frame.names:
            return state
        if state.node == 0:
            logits = self._model.logits().copy()
            self._begun = NameBegun(len(pieces), state, self._model.decoded, logits)
        elif self._begun is not None and not self._goes_on(state):
            return self._taken_back(self._begun, pieces)
        return state

    def _goes_on(self, state: State) -> bool:
        """Return whether the token that the model wants most may follow."""
        piece = self._model.table.pieces[best_token(self._model.logits())]
        return bool(piece) and self._automaton.advance(state, piece, closing=True) is not None

    def _taken_back(self, begun: NameBegun, pieces: list[bytes]) -> State | None:
        word, tokens, chances = best_name(self._model, begun)
        self._log.replace(begun.pieces, chances)
        pieces[begun.pieces :] = [self._model.table.pieces[token] for token in tokens]
        self._model.rewind(begun.decoded)
        self._model.extend(tokens)
        return self._automaton.advance(begun.state, word)


def best_name(model: GgufModel, begun: NameBegun) -> tuple[str, list[int], list[float]]:
    """Return the likeliest name that may stand there, its tokens and their log-probabilities.

    The cache then holds what stood before the name, and what was run last; rewind it.
    """
    words = begun.state.frame.words
    trie = trie_of([model.tokens(word) for word in words])
    found: dict[int, float] = {0: 0.0}
    waiting = [(0.0, 0)]
    while True:
        _, number = heappop(waiting)
        if trie[number].ends:
            path = path_to(trie, number)
            gains = np.diff([0.0, *(found[one] for one in path)]).tolist()
            return words[trie[number].ends[0]], [trie[one].token for one in path], gains
        logits = begun.logits
        if number:
            model.rewind(begun.decoded)
            model.extend([trie[one].token for one in path_to(trie, number)])
            logits = model.logits()
        for token, chance in _chances(logits, list(trie[number].children)):
            child = trie[number].children[token]
            found[child] = found[number] + chance
            heappush(waiting, (-found[child], child))


def _chances(logits: Logits, tokens: Sequence[int]) -> list[tuple[int, float]]:
    """Return the log-probabilities of some tokens among all."""
    top = float(logits.max())
    whole = top + float(np.log(np.exp(logits - np.float32(top)).sum(dtype=np.float64)))
    return [(token, min(float(logits[token]) - whole, 0.0)) for token in tokens]
