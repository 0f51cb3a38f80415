"""Sets of words that follow each other: what automata over bytes are made of."""

from collections.abc import Callable, Sequence
from typing import NamedTuple


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


END = trie([])._replace(ends=True)
