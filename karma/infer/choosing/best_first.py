"""Search for the best continuation, best prefix first.

No continuation can score more than what it begins with, because log p <= 0; so the first one that
leads every unfinished prefix has won.
"""

import heapq
from collections.abc import Callable, Sequence

from karma.infer.choosing.token_trie import Floats, Node


class Race:
    """The prefixes that are scored, by the most that each can come to.

    Args:
        trie: what runs.
        found: scores of its nodes, filled in as they become known.
        average: whether a continuation's score is divided by its tokens.
        settle: puts a node's score in place of a bound on it, and says whether it was one; without
            it there are no bounds.
    """

    def __init__(
        self,
        trie: Sequence[Node],
        found: Floats,
        *,
        average: bool,
        settle: Callable[[int], bool] = lambda number: False,
    ) -> None:
        self._trie, self._found, self._average, self._settle = trie, found, average, settle
        self._queue: list[tuple[float, int]] = []  # (minus the most it can come to, node); a heap
        self._ended: list[tuple[float, int, int]] = []  # (-score, continuation, node); a heap

    def run(self, score_below: Callable[[int], None]) -> tuple[float, int, int]:
        """Return the best that ends: score, continuation (the first of equals), node.

        Args:
            score_below: fills in the scores of a node's children, the root's first.
        """
        leader: int | None = 0
        while leader is not None:
            score_below(leader)
            self._enter(leader)
            leader = self._leader()
        score, one, number = self._ended[0]
        return -score, one, number

    def _enter(self, number: int) -> None:
        """Let the children of a node in, now that they have scores."""
        for child in self._trie[number].children.values():
            self._push(child)

    def _leader(self) -> int | None:
        """Take out the best prefix to go on from; None when the race is over."""
        while self._queue and not self._decided():
            _, number = heapq.heappop(self._queue)
            if self._settle(number):
                self._push(number)
                continue
            node = self._trie[number]
            score = self._found[number] / (node.depth if self._average else 1)
            for one in node.ends:
                heapq.heappush(self._ended, (-float(score), one, number))
            if node.children:
                return number
        return None

    def _push(self, number: int) -> None:
        most = self._found[number] / (self._trie[number].longest if self._average else 1)
        heapq.heappush(self._queue, (-float(most), number))

    def _decided(self) -> bool:
        """Return whether nothing in the queue can come up to what has ended; equals can."""
        return bool(self._ended) and self._ended[0][0] < self._queue[0][0]
