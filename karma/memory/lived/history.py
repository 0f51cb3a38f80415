"""What was so and when: one episode for each time that a thing came to be somewhere or otherwise.

An unchanged sighting extends the episode it belongs to; only changes make new ones.
"""

from bisect import insort
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from karma.contracts import Asked, Deed, Said, Sighting
from karma.memory.lived.beliefs import Belief


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One thing at one place in one state, from a first to a last sighting of it."""

    sighting: Sighting  # the last
    since_s: float
    deed: Deed | None = None  # that it began with

    def seen_at(self, before_s: float | None) -> Sighting:
        """Return it as it was seen last before a time."""
        if before_s is None or self.sighting.time_s <= before_s:
            return self.sighting
        return replace(self.sighting, time_s=max(self.since_s, before_s))


class History:
    """Episodes by object type, in the order of their beginnings."""

    def __init__(self) -> None:
        self._by_type: dict[str, list[Episode]] = {}
        self._open: dict[str, Belief] = {}  # by object id; their episodes are not yet closed
        self._number = 0

    def __len__(self) -> int:
        return self._number + len(self._open)

    def add(self, belief: Belief) -> None:
        """Begin an episode."""
        self._open[belief.sighting.object_id] = belief

    def close(self, belief: Belief) -> None:
        """End the episode of a belief, with its last sighting."""
        begun = self._open.pop(belief.sighting.object_id, None)
        if begun is None:
            return
        ended = Episode(sighting=belief.sighting, since_s=begun.since_s, deed=begun.deed)
        rows = self._by_type.setdefault(belief.sighting.object_type, [])
        insort(rows, ended, key=lambda one: one.since_s)
        self._number += 1

    def drop(self, object_id: str) -> None:
        """Forget all episodes of a thing."""
        self._open.pop(object_id, None)
        for kind, rows in self._by_type.items():
            left = [one for one in rows if one.sighting.object_id != object_id]
            self._number -= len(rows) - len(left)
            self._by_type[kind] = left

    def find(self, ranks: Mapping[str, int], said: Said, asked: Asked) -> Iterator[Episode]:
        """Yield episodes of some types: those of the asked time, person and deed, newest first."""
        found = [
            one
            for kind, rows in self._by_type.items()
            if not ranks or kind in ranks
            for one in rows
        ]
        found += [
            Episode(sighting=one.sighting, since_s=one.since_s, deed=one.deed)
            for one in self._open.values()
            if not ranks or one.sighting.object_type in ranks
        ]
        wanted = [one for one in found if _fits(one, said, asked)]
        wanted.sort(key=lambda one: (ranks.get(one.sighting.object_type, 0), -one.since_s))
        return iter(wanted)


def _fits(episode: Episode, said: Said, asked: Asked) -> bool:
    """Return whether an episode is of the person, the deed and the time that were said."""
    deed = episode.deed
    if said.who and (deed is None or deed.who != said.who):
        return False
    if said.action and (deed is None or deed.action != said.action):
        return False
    if asked == "who" and deed is None:
        return False
    if said.who or said.action:
        begun = deed.time_s if deed is not None else episode.since_s
        after = said.after_s is None or begun >= said.after_s
        return after and (said.before_s is None or begun <= said.before_s)
    return said.before_s is None or episode.since_s <= said.before_s
