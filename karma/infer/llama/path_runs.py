"""Run a trie behind a prompt path after path, keeping what a path shares with the one before.

So each continuation lies in the very cells that it would have alone, and its logits are those of a
run of its own, bit for bit. All paths in one batch take less time, but lie in other cells: the sums
of their attention are taken in another order, and with weights, or kept keys and values, of 16 bits
the log-probability of an unlikely text moves by a few thousandths.
"""

from collections.abc import Sequence

from karma.infer.choosing.token_trie import Floats, Node, lowest_run, path_to, score_children
from karma.infer.llama.sequence_cache import SequenceCache


class PathRuns:
    """Scores nodes of a trie by running the paths to them.

    Args:
        cache: with the prompt in it.
        trie: what to run.
        found: scores of its nodes; those of the root's children are known.
        start: tokens of the prompt.

    Attributes:
        count: tokens run.
    """

    def __init__(
        self, cache: SequenceCache, trie: Sequence[Node], found: Floats, start: int
    ) -> None:
        self.count = 0
        self._cache, self._trie, self._found, self._start = cache, trie, found, start
        self._path: tuple[int, ...] = ()  # in the cache
        self._known = {0}  # nodes whose children have scores

    def score_all(self) -> None:
        """Score every node."""
        for number in lowest_run(self._trie):
            self._run(path_to(self._trie, number))

    def score_below(self, number: int) -> None:
        """Score the children of a node, whose parent's are scored.

        Where only one way leads on, it is run along: two tokens take as long as one.
        """
        if number in self._known:
            return
        last = number
        while len(inner := self._inner(last)) == 1:
            last = inner[0]
        self._run(path_to(self._trie, last))

    def _inner(self, number: int) -> list[int]:
        children = self._trie[number].children.values()
        return [child for child in children if self._trie[child].children]

    def _run(self, path: tuple[int, ...]) -> None:
        same = 0
        for old, new in zip(self._path, path, strict=False):
            if old != new:
                break
            same += 1
        self._cache.forget(self._start + same)
        self._path = path
        for first in range(same, len(path), self._cache.batch):
            nodes = path[first : first + self._cache.batch]
            tokens = [self._trie[number].token for number in nodes]
            logits = self._cache.decode(tokens, self._start + first)
            score_children(self._trie, self._found, nodes, logits)
            self._known.update(nodes)
        self.count += len(path) - same
