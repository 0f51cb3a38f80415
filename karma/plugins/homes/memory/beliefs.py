"""What is believed of each thing: where it was seen last, since when, and why no more.

Contradiction evicts: a thing that is not at a place that was looked over is believed there no more
from that moment on, with the reason; seen elsewhere or otherwise corrects it at once, and what a
resident takes along is nowhere until it is seen again. A look may miss what stands behind something
(`OVERLOOKED`), so of what hardly ever moves one look in vain leaves a doubt, and the next one
evicts it.
"""

from collections.abc import Iterator
from dataclasses import replace

from karma.household.places import HAND
from karma.plugins.homes.memory.ageing import Ageing
from karma.plugins.homes.memory.episodes import Belief
from karma.plugins.homes.types import Deed, HomeMoment, Sighting

ROBOT = "robot"
OVERLOOKED = 0.01  # chance that a look does not show what is known to be there; 39 of 5,552
KEPT = 0.5  # chance from which on a thing is still believed to be where a look did not show it


class Beliefs:
    """Beliefs by object id, kept true by every moment, from which their ageing learns."""

    def __init__(self, ageing: Ageing) -> None:
        self._ageing = ageing
        self._by_id: dict[str, Belief] = {}
        self._at: dict[str, dict[str, None]] = {}  # place -> ids believed there
        self._fresh: dict[str, None] = {}  # ids that changed since they were told last

    def __iter__(self) -> Iterator[Belief]:
        return iter(self._by_id.values())

    def __len__(self) -> int:
        return len(self._by_id)

    def get(self, object_id: str) -> Belief | None:
        """Return what is believed of a thing."""
        return self._by_id.get(object_id)

    def forget(self, object_id: str) -> None:
        """Drop a belief."""
        belief = self._by_id.pop(object_id, None)
        if belief is not None:
            self._leave(belief)

    def fresh(self) -> list[Belief]:
        """Return the beliefs that were confirmed, doubted or made since this was asked last."""
        found = [self._by_id[key] for key in self._fresh if key in self._by_id]
        self._fresh.clear()
        return found

    def take_in(self, moment: HomeMoment) -> list[tuple[Belief | None, Belief]]:
        """Correct beliefs by a moment; return what changed: the belief before, and the new one."""
        changed = [pair for seen in moment.seen if (pair := self._see(seen, moment.deed))]
        if moment.looked_over:
            since_s = moment.time_s if moment.looked_since_s is None else moment.looked_since_s
            for place_id in moment.looked_over:
                there = self._at.get(place_id, {})
                gone = [one for one in there if self._by_id[one].sighting.time_s < since_s]
                changed += filter(None, [self._end(one, moment.time_s) for one in gone])
        return changed

    # ------------------------------------------------------------- parts

    def _see(self, seen: Sighting, deed: Deed | None) -> tuple[Belief | None, Belief] | None:
        old = self._by_id.get(seen.object_id)
        self._fresh[seen.object_id] = None
        new = Belief(sighting=seen, since_s=seen.time_s, deed=deed)
        if seen.place_id == HAND and deed is not None and deed.who != ROBOT:
            new = replace(new, ended_s=seen.time_s, reason="carried off")
        if old is None:
            self._keep(new)
            return None, new
        same_place = old.sighting.place_id == seen.place_id and old.ended_s is None
        self._learn(old, seen, deed, moved=not same_place)
        if same_place and old.sighting.states == seen.states and deed is None:
            self._by_id[seen.object_id] = replace(old, sighting=seen, chance=1.0, looked_s=None)
            return None
        if not new.reason:
            new = replace(new, reason="otherwise" if same_place else "seen elsewhere")
        self._leave(old)
        self._keep(new)
        return old, new

    def chance(self, belief: Belief, time_s: float) -> float:
        """Return the chance that a thing was not moved from where it was seen."""
        seen = belief.sighting
        since = seen.time_s if belief.looked_s is None else belief.looked_s
        hours = self._ageing.hours(seen.object_type, since, max(time_s, since))
        return belief.chance * self._ageing.stays(seen.object_id, seen.object_type, hours)

    def _end(self, object_id: str, time_s: float) -> tuple[Belief, Belief] | None:
        """Evict a belief that a look contradicts, or doubt it; return it as it was and is."""
        old = self._by_id[object_id]
        self._fresh[object_id] = None
        seen = old.sighting
        hours = self._ageing.hours(seen.object_type, seen.time_s, time_s)
        before = self.chance(old, time_s)
        chance = before * OVERLOOKED / (before * OVERLOOKED + 1.0 - before)
        if chance >= KEPT:
            self._by_id[object_id] = replace(old, chance=chance, looked_s=time_s)
            return None
        self._ageing.learn(object_id, old.sighting.object_type, hours, moved=True)
        new = replace(old, ended_s=time_s, reason="not there")
        self._leave(old)
        self._by_id[object_id] = new
        return old, new

    def _learn(self, old: Belief, seen: Sighting, deed: Deed | None, *, moved: bool) -> None:
        """Count a confirmation or a move of the household's people; not the robot's own deeds."""
        if old.ended_s is not None or old.sighting.place_id == HAND:
            return  # the move was counted when it was missed or seen
        if deed.who == ROBOT if deed is not None else seen.place_id == HAND:
            return
        hours = self._ageing.hours(seen.object_type, old.sighting.time_s, seen.time_s)
        self._ageing.learn(seen.object_id, seen.object_type, hours, moved=moved)

    def _keep(self, belief: Belief) -> None:
        seen = belief.sighting
        self._by_id[seen.object_id] = belief
        if seen.place_id is not None:
            self._at.setdefault(seen.place_id, {})[seen.object_id] = None

    def _leave(self, belief: Belief) -> None:
        place_id = belief.sighting.place_id
        if place_id is not None:
            self._at.get(place_id, {}).pop(belief.sighting.object_id, None)
