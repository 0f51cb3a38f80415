"""What a memory of n units could at best have known, from the truth of all requests.

A request can be answered from memory if its thing was seen where it is now. A unit that is to serve
it is held from the last such sighting to the request. n units that know the future serve the most
requests when, of all that are wanted at one time, those that are wanted last give way: the largest
part of a set of intervals that n lines can hold (Faigle and Nawijn 1995, Carlisle and Lloyd 1995).
"""

import heapq
from collections.abc import Iterable


def most_known(waits: Iterable[tuple[float, float]], units: int) -> int:
    """Return how many requests so many units could at best have served.

    Args:
        waits: of each request, when its thing was seen last and when it is asked for, seconds.
        units: of the memory, each held for one request at a time.

    >>> most_known([(0, 9), (1, 4), (2, 5), (5, 8)], 1), most_known([(0, 9), (1, 4), (2, 5)], 2)
    (2, 2)
    """
    held: list[tuple[float, float]] = []  # the one that is wanted last stands first: -end, start
    served = 0
    for start, end in sorted(waits):
        done = [one for one in held if -one[0] <= start]
        if done:
            held = [one for one in held if -one[0] > start]
            heapq.heapify(held)
            served += len(done)
        heapq.heappush(held, (-end, start))
        if len(held) > units:
            heapq.heappop(held)
    return served + len(held)
