"""CAPEAM's environment-aware memory, of objects instead of pictures, over one sequence."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from karma.bench.rows.baseline import RoomMemory, likely_places
from karma.contracts import Area, SeenObject, Vec3
from karma.household.types import object_types
from karma.household.uses import covers

NEAR_M = 1.5  # furniture this near to an area speaks for it
ANYWHERE = 0.05  # what a place weighs of which nothing is known


@dataclass
class EnvironmentMemory(RoomMemory):
    """Maps the objects of one room that were seen, and where the agent cut and put them."""

    put: dict[tuple[str, str], list[str]] = field(default_factory=dict)  # thing, place -> ids
    sliced_at: dict[str, Vec3] = field(default_factory=dict)  # type -> where it was cut
    explored: set[str] = field(default_factory=set)  # areas looked round from
    masked: set[str] = field(default_factory=set)  # ids that this sub-goal passes over

    # ------------------------------------------------------------- writing

    def was_put(self, thing: str, place: str, object_id: str) -> None:
        """Note where a thing was put."""
        ids = self.put.setdefault((thing, place), [])
        if object_id not in ids:
            ids.append(object_id)

    def begin_subgoal(self, thing: str = "", place: str = "") -> None:
        """Set the objects to ignore: only things of a type that already are at a type of place."""
        self.masked = set(self.put.get((thing, place), ()))

    # ------------------------------------------------------------- reading

    def best(self, name: str) -> SeenObject | None:
        """Return the nearest object of a type or piece of one that is not masked.

        Of what was cut the pieces count, the nearest to where that was.
        """
        cut = self.sliced_at.get(name)
        x, _, z = cut or self.here()

        def rank(one: SeenObject) -> tuple[bool, float, str]:
            whole = cut is not None and one.object_type == name
            at = one.box_center_m
            return whole, round(math.dist((at[0], at[2]), (x, z)), 3), one.object_id

        fitting = [one for one in self._all(name) if one.object_id not in self.masked]
        return min(fitting, key=rank, default=None)

    def passes_over(self, kind: str) -> bool:
        """Return whether an object of this type is masked."""
        return any(one.object_id in self.masked for one in self._all(kind))

    def _all(self, kind: str) -> list[SeenObject]:
        return [one for one in self.seen.values() if covers(kind, one.object_type)]

    # ------------------------------------------------------------- where to look

    def weights(self, kind: str, areas: Iterable[Area]) -> list[float]:
        """Return how likely a thing of a type is near each area, from the furniture seen there."""
        shares = likely_places(kind)
        found = []
        for area in areas:
            near = {
                one.object_type for one in self.seen.values() if _gap(one, area.position_m) < NEAR_M
            }
            found.append(ANYWHERE + sum(shares.get(name, 0.0) for name in sorted(near)))
        return found

    def closed(self, kind: str) -> list[tuple[SeenObject, float]]:
        """Return the closed receptacles that can hold a type, by id, and how likely it is there."""
        shares, kinds = likely_places(kind), object_types()
        thing = kinds.get(kind)
        if thing is None or not thing.can("pickupable"):
            return []
        shut = [
            one
            for _, one in sorted(self.seen.items())
            if "closed" in one.states and (box := kinds.get(one.object_type)) is not None
            if box.can("receptacle") and thing.fits(box)
        ]
        types = [one.object_type for one in shut]
        return [
            (one, (ANYWHERE + shares.get(one.object_type, 0.0)) / types.count(one.object_type))
            for one in shut
        ]


def _gap(one: SeenObject, point: Vec3) -> float:
    gaps = (
        max(abs(point[axis] - one.box_center_m[axis]) - one.box_size_m[axis] / 2, 0.0)
        for axis in (0, 2)
    )
    return math.hypot(*gaps)
