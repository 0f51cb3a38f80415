"""Two ways to run a trie behind a prompt: path after path, or all of it in one batch.

In one batch the continuations lie in other cells than they would have alone, so the sums of their
attention are taken in another order. With weights, or kept keys and values, of 16 bits that shows:
a value rounded the other way in one layer moves the log-probability of an unlikely text by a few
thousandths. Path after path, each lies in the very cells of the naive way, and the logits are its
logits, bit for bit.
"""

from collections.abc import Iterator, Sequence

from karma.infer.llama.sequence_cache import SEQUENCES, SequenceCache
from karma.infer.llama.token_trie import Floats, Node, lowest_run, path_to, score_children


class PathRuns:
    """Runs paths in sequence 0; what a path shares with the one before is not run again.

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
            places = range(self._start + first, self._start + first + len(nodes))
            tokens = [self._trie[number].token for number in nodes]
            logits = self._cache.decode(tokens, places, [[0]] * len(nodes))
            score_children(self._trie, self._found, nodes, logits)
            self._known.update(nodes)
        self.count += len(path) - same


def score_together(cache: SequenceCache, trie: Sequence[Node], found: Floats, start: int) -> int:
    """Score every node in one batch, a token in as many sequences as pass through it.

    A trie that needs more sequences or more room than there are takes several. Arguments as of
    `PathRuns`.

    Returns:
        How many tokens were run.
    """
    return sum(
        _together(cache, trie, found, start, leaves)
        for leaves in _groups(trie, cache.cells - start)
    )


def _together(
    cache: SequenceCache, trie: Sequence[Node], found: Floats, start: int, leaves: Sequence[int]
) -> int:
    through: dict[int, list[int]] = {}
    for sequence, leaf in enumerate(leaves, start=1):
        for number in path_to(trie, leaf):
            through.setdefault(number, []).append(sequence)
        cache.copy(0, sequence, start)
    order = sorted(through, key=lambda number: (trie[number].depth, number))
    for first in range(0, len(order), cache.batch):
        nodes = order[first : first + cache.batch]
        logits = cache.decode(
            [trie[number].token for number in nodes],
            [start + trie[number].depth - 1 for number in nodes],
            [through[number] for number in nodes],
        )
        score_children(trie, found, nodes, logits)
    cache.forget(start)
    return len(order)


def _groups(trie: Sequence[Node], room: int) -> Iterator[list[int]]:
    """Yield the lowest nodes that have to be run, in groups that fit one cache."""
    group: list[int] = []
    run: set[int] = set()
    for leaf in lowest_run(trie):
        path = set(path_to(trie, leaf))
        if group and (len(group) == SEQUENCES - 1 or len(run | path) > room):
            yield group
            group, run = [], set()
        group.append(leaf)
        run |= path
    if group:
        yield group
