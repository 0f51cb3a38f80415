"""Choose the likeliest of a closed list of texts, token by token, whoever tells the chances.

A node of the trie is what some continuations begin with; the root is the prompt alone. A last
token is never run: the logits after its parent hold its score.
"""

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError

Floats = NDArray[np.float64]
Logits = NDArray[np.float32]

_ROWS = 16  # of logits turned to log-probabilities at a time


@dataclass(slots=True)
class Node:
    """What some continuations begin with."""

    token: int
    depth: int
    parent: int
    children: dict[int, int] = field(default_factory=dict)  # token -> node
    ends: list[int] = field(default_factory=list)  # continuations that end here
    longest: int = 0  # tokens of the longest continuation through here


def trie_of(continuations: Sequence[Sequence[int]]) -> list[Node]:
    """Return the trie of token lists, parents before children, the root first.

    ValueError where there is none, or one has no token.
    """
    if not continuations:
        raise ValueError("there is no continuation to score")
    trie = [Node(token=-1, depth=0, parent=0)]
    for one, tokens in enumerate(continuations):
        if not tokens or min(tokens) < 0:
            raise ValueError(f"continuation {one} has no token")
        number = 0
        for token in tokens:
            trie[number].longest = max(trie[number].longest, len(tokens))
            if token not in trie[number].children:
                trie[number].children[token] = len(trie)
                trie.append(Node(token=token, depth=trie[number].depth + 1, parent=number))
            number = trie[number].children[token]
        trie[number].longest = max(trie[number].longest, len(tokens))
        trie[number].ends.append(one)
    return trie


def path_to(trie: Sequence[Node], number: int) -> tuple[int, ...]:
    """Return the nodes from below the root down to one."""
    path = []
    while number:
        path.append(number)
        number = trie[number].parent
    return tuple(path[::-1])


def score_children(
    trie: Sequence[Node], found: Floats, nodes: Sequence[int], logits: Logits
) -> None:
    """Score the children of `nodes`, whose own scores are `found`; `logits` has a row per node.

    ModelError where the logits are not numbers.
    """
    for start in range(0, len(nodes), _ROWS):
        rows = logits[start : start + _ROWS]
        totals = _log_sum_exp(rows)
        for row, total, number in zip(rows, totals, nodes[start : start + _ROWS], strict=True):
            children = trie[number].children
            chances = row[list(children)].astype(np.float64) - total
            found[list(children.values())] = found[number] + np.minimum(chances, 0.0)


def _log_sum_exp(logits: Logits) -> Floats:
    top = logits.max(axis=1)
    if not np.isfinite(top).all():
        raise ModelError("the model's logits are not numbers: damaged weights")
    total = np.exp(logits - top[:, None]).sum(axis=1)
    found: Floats = top.astype(np.float64) + np.log(total.astype(np.float64))
    return found


class Race:
    """The prefixes that are scored, by the most that each can come to.

    No continuation can score more than what it begins with, because log p <= 0; so the first one
    that leads every unfinished prefix has won. `found` has the scores of nodes as they become
    known; with `average` a continuation's is divided by its tokens.
    """

    def __init__(self, trie: Sequence[Node], found: Floats, *, average: bool) -> None:
        self._trie, self._found, self._average = trie, found, average
        self._queue: list[tuple[float, int]] = []  # (minus the most it can come to, node); a heap
        self._ended: list[tuple[float, int, int]] = []  # (-score, continuation, node); a heap

    def run(self, score_below: Callable[[int], None]) -> tuple[float, int, int]:
        """Return the best that ends: score, continuation (the first of equals), node.

        `score_below` fills in the scores of a node's children, the root's first.
        """
        leader: int | None = 0
        while leader is not None:
            score_below(leader)
            for child in self._trie[leader].children.values():
                most = self._found[child] / (self._trie[child].longest if self._average else 1)
                heapq.heappush(self._queue, (-float(most), child))
            leader = self._leader()
        score, one, number = self._ended[0]
        return -score, one, number

    def _leader(self) -> int | None:
        """Take out the best prefix to go on from; None when the race is over."""
        while self._queue:
            if self._ended and self._ended[0][0] < self._queue[0][0]:  # equals can come up to it
                break
            _, number = heapq.heappop(self._queue)
            node = self._trie[number]
            score = self._found[number] / (node.depth if self._average else 1)
            for one in node.ends:
                heapq.heappush(self._ended, (-float(score), one, number))
            if node.children:
                return number
        return None
