"""Getting a known thing within reach and acting on it, with the world's refusals as words."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from karma.agent.body.refusals import RefusedError, explained, of_its_kind
from karma.agent.body.sightings import Naming, Sightings, known
from karma.agent.body.walk import Stance, Target, Walker
from karma.agent.seeing.eyes import Eyes
from karma.agent.seeing.perceive import place_of, refusal
from karma.agent.seeing.projection import unseen
from karma.household.pieces import base_type
from karma.household.types import types_with
from karma.household.uses import BASIN_OF, without_basin
from karma.types.memory import Known
from karma.types.observation import Observation, SeenObject
from karma.types.roles import Event, Knowledge, Stage
from karma.types.space import Vec3, outside_m

_CURES = {"open": "CloseObject", "on": "ToggleOff", "closed": "OpenObject"}  # what would help
_SMALL_M = 1.0  # furniture up to this long is seen whole from its edge
_ON_TOP_M = 0.01  # a thing whose height is no lower than that below the top stands on it


@dataclass(frozen=True, slots=True, kw_only=True)
class SkillLimits:
    """How hard a skill tries."""

    max_actions: int = 900  # world actions of one skill
    views: int = 10  # places tried to get an immovable thing into view
    views_of_movable: int = 6  # the same for a thing that may have been moved
    retries: int = 3  # places tried to act from, after a refusal that room may cure
    reach_m: float = 1.4  # horizontally; AI2-THOR sees and reaches to 1.5 m
    cover_m: float = 1.0  # without area nodes, every cell is looked at from this near
    look_again_m: float = 0.5  # the same for what was not found from the area nodes


class Reach:
    """The agent's body, eyes and memory together: from a name to a thing within reach."""

    def __init__(
        self,
        world: Stage,
        knowledge: Knowledge,
        limits: SkillLimits,
        eyes: Eyes,
        before: Mapping[str, SeenObject],
    ) -> None:
        self.world, self.knowledge, self.limits, self._eyes = world, knowledge, limits, eyes
        self.log, self._before = Sightings(), before
        self.walker = Walker(world, max_actions=limits.max_actions)
        self.names = Naming(self.log, knowledge, self.walker.gap, before)
        self.used: list[str] = []  # ids that names resolved to since `start`
        self.explorations = 0  # since `start`
        self.kept_shut: frozenset[str] = frozenset()  # types that are not to be opened

    def start(self) -> None:
        """Begin a skill."""
        self.used, self.explorations = [], 0
        self.walker.start()
        self.look()

    def look(self, event: Event | None = None, touched: Sequence[str] = ()) -> Observation:
        """Note what is in view after an action, the last by default, that touched some objects."""
        event = self.world.last_event if event is None else event
        observation = self._eyes.observe(event, touched=touched, known=self.names)
        self.log.add(observation)
        return observation

    # ------------------------------------------------------------- which object

    def resolve(self, name: str, *, state: str = "", held: bool = True) -> Known:
        """Return what a name means, a basin for its sink and back; refuses what is not known."""
        found = self.names.find(name, state=state, held=held)
        for sink, basin in BASIN_OF.items():
            if found is None and name in (sink, basin):
                found = self.names.find(basin if name == sink else sink, held=held)
        if found is None:
            raise RefusedError(f"no {name} is known; Explore(robot, '{name}') first")
        return found

    # ------------------------------------------------------------- getting there, and acting

    def approach(self, target: Known, *, closed_will_do: bool = False) -> bool:
        """Go where an object is within reach; refuses what is not there, or is shut in.

        With `closed_will_do`, its closed container in view is near enough: then it returns False.
        """
        self.use(target)
        log, object_id, kind = self.log, target.object_id, target.object_type
        movable = kind in types_with("pickupable")
        views = self.limits.views_of_movable if movable else self.limits.views
        tried: list[Stance] = []
        place = None
        while object_id != log.held_id and object_id not in log.within_reach:
            if len(tried) >= views or not self.next_stance(target, tried):
                break
            place = log.in_view.get(target.place_id or "")
            if place is not None and self._closed_over(place, target.position_m):
                break
            place = None
        if object_id == log.held_id or object_id in log.within_reach:
            return True
        if place is None and movable:
            place = self.shut_in(target)
        if place is not None:
            log.focus[place.object_type] = place.object_id
            if closed_will_do:
                self.used.append(place.object_id)
                return False
            raise RefusedError(
                f"{kind} is in the closed {place.object_type}; "
                f"OpenObject(robot, '{place.object_type}') first",
                f"{object_id} is in {place.object_id}, which is closed; "
                f"OpenObject(robot, '{place.object_id}') first",
            )
        if movable or tried:
            log.missed[object_id] = target.position_m
        if not movable:
            raise RefusedError(
                f"could not get {kind} into view and reach",
                f"{object_id} could not be got into view and reach"
                f"{of_its_kind([one.object_id for one in self.others(target)])}",
            )
        where = f", in or on {target.place_id}" if target.place_id else ""
        raise RefusedError(
            f"{kind} is not at its remembered place; Explore(robot, '{kind}') to find it",
            f"{object_id} is not where it was last seen{where}; "
            f"Explore(robot, '{base_type(kind)}') to find it",
        )

    def shut_in(self, target: Known) -> SeenObject | None:
        """Return the closed container that a thing is believed to be in, if any.

        The one it was last seen in; else the one around it, as where it lies in a bowl in there.
        """
        place = self.log.seen.get(target.place_id or "")
        if place is not None and self._closed_over(place, target.position_m):
            return place
        around = (
            sight
            for sight in self.log.seen.values()
            if not any(outside_m(target.position_m, sight.box_center_m, sight.box_size_m))
            if sight.object_type in types_with("receptacle") and "closed" in self.log.states(sight)
        )
        return min(around, key=lambda sight: sight.object_id, default=None)

    def _closed_over(self, container: SeenObject, point: Vec3) -> bool:
        """Return whether a container is closed, and a point in it does not lie on its top."""
        top = container.box_center_m[1] + container.box_size_m[1] / 2
        return point[1] < top - _ON_TOP_M and "closed" in self.log.states(container)

    def others(self, target: Known) -> list[Known]:
        """Return the other known objects of a type, the nearest first."""
        same = [one for one in self._all_known() if one.object_type == target.object_type]
        found = {one.object_id: one for one in same if one.object_id != target.object_id}
        gap = self.walker.gap
        return sorted(found.values(), key=lambda one: (gap(one.position_m), one.object_id))

    def known_types(self) -> list[str]:
        """Return the types that the agent knows a thing of, the nearest first; a basin is its sink.

        Those of the map and of what was seen and, of what holds things and can be carried, those
        that are remembered.
        """
        there = [(self.walker.gap(one.position_m), one.object_type) for one in self._all_known()]
        there += [(math.inf, kind) for area in self.knowledge.areas() for kind in area.contains]
        return list(dict.fromkeys(without_basin(kind) for _, kind in sorted(there)))

    def _all_known(self) -> list[Known]:
        """Return the map's furniture, memory's vessels and all that was seen, but what is held."""
        mapped = [one for area in self.knowledge.areas() for one in area.fixtures]
        vessels = sorted(types_with("receptacle") & types_with("pickupable"))
        remembered = [one for kind in vessels if (one := self.knowledge.where(kind)) is not None]
        seen = {**self._before, **self.log.seen}.values()
        away = {self.log.held_id, *self.log.missed}
        found = [*mapped, *remembered, *map(known, seen)]
        return [one for one in found if one.object_id not in away]

    def next_stance(
        self,
        target: Known,
        tried: list[Stance],
        *,
        least_gap_m: float = 0.0,
        nearest: bool = False,
    ) -> bool:
        """Go to the best place not yet tried to see an object from, and look.

        Returns False if none is left. Places nearer than `least_gap_m` come later; `nearest` ranks
        by the distance to the object, however far the way. After a failure, the view that the
        object was last seen from comes first.
        """
        sight = self.log.seen.get(target.object_id)
        box = _box_of(target)
        before: list[Stance] = []
        if sight is not None and sight.position_m == target.position_m:
            box = Target(center_m=sight.box_center_m, size_m=sight.box_size_m)
            pose = self.log.seen_from.get(target.object_id)
            if len(tried) == 1 and pose is not None:
                before = [self.walker.stance(pose)]
        ranked = self.walker.views(box, reach_m=self.limits.reach_m, least_gap_m=least_gap_m)
        used = {(view.state, view.horizon_deg) for view in tried}
        fresh = [v for v in (*before, *ranked) if (v.state, v.horizon_deg) not in used]
        fresh.sort(key=lambda view: any(_alike(view, other) for other in tried))
        for view in sorted(fresh, key=lambda view: view.gap_m) if nearest else fresh:
            tried.append(view)
            if self.stand(view):
                return True
        return False

    def stand(self, view: Stance) -> bool:
        """Go to a place and look from there; False where something is in the way."""
        there = self.walker.walk(view.state) and self.walker.look(view.horizon_deg)
        if there:
            self.look()
        return there

    def look_at_point(
        self, point: Vec3, things: Sequence[SeenObject], *, nearest: bool = False
    ) -> bool:
        """Go to where a point comes into view past things, and look; False where that is nowhere.

        To the place nearest to the point, or else to the cheapest.
        """
        reach_m = self.limits.reach_m
        views = self.walker.views(Target(center_m=point), reach_m=reach_m)
        views = [view for view in views if view.gap_m <= reach_m]
        if nearest:
            views.sort(key=lambda view: view.gap_m)
        for view in views:
            if unseen([point], [self.walker.camera_of(view)], things, reach_m=reach_m):
                continue
            if self.stand(view):
                return True
        return False

    def act(
        self,
        target: Known,
        action: str,
        *,
        also: str | None = None,
        in_passing: bool = False,
        from_here: bool = False,
    ) -> Observation:
        """Do one action on an object, going there first, and again from elsewhere if that may help.

        `also` is another object that it handles; an action `in_passing` is not remembered; with
        `from_here` the agent stays where it is. Refuses with the world's reason.
        """
        if action == "OpenObject" and target.object_type in self.kept_shut:
            raise RefusedError(f"{target.object_type} is not to be opened, as was said")
        self.approach(target)
        before = self.log.seen.get(target.object_id)
        event = self.walker.do(action, **self._eyes.aim(target.object_id))
        tried: list[Stance] = []
        least_gap_m = 0.75 if action in ("OpenObject", "CloseObject") else 0.0
        while not from_here and (why := refusal(event)) is not None and why.elsewhere:
            if len(tried) == self.limits.retries:
                break
            if not self.next_stance(target, tried, least_gap_m=least_gap_m):
                break
            if target.object_id in self.log.within_reach:
                event = self.walker.do(action, **self._eyes.aim(target.object_id))
        touched = [target.object_id] if also is None else [also, target.object_id]
        observation = self.done(target, event, touched, in_passing=in_passing)
        self.log.acted(action, target.object_id, place_of(before) if before else None)
        return observation

    def done(
        self, target: Known, event: Event, touched: list[str], *, in_passing: bool = False
    ) -> Observation:
        """Note what an action did to an object, or refuse with the world's words."""
        observation = self.look(event, touched)
        if (why := observation.reason) is not None:
            others = [one.object_id for one in self.others(target)]
            detail = explained(why, target, others, self.known_types())
            cure = _CURES.get(why.kind)
            advice = f" Do {cure}(robot, '{target.object_type}') first." if cure else ""
            raise RefusedError(f"{why.words}{advice}", detail, why)
        if not in_passing:
            self.log.handled(touched, target.position_m)
            self.used = [*touched, *self.used]
            self.log.focus[target.object_type] = target.object_id
        return observation

    def use(self, target: Known) -> None:
        """Note that a name meant this thing."""
        self.used.append(target.object_id)
        self.log.focus[target.object_type] = target.object_id


def _box_of(target: Known) -> Target:
    """Return the box of an object if it is known, else the point that it is at.

    The middle of a large object, or of one that opens, shows what lies on it or in it.
    """
    opens = target.object_type in types_with("openable")
    if target.box_center_m is None or opens or max(target.box_size_m) > _SMALL_M:
        return Target(center_m=target.position_m)
    return Target(center_m=target.box_center_m, size_m=target.box_size_m)


def _alike(one: Stance, other: Stance) -> bool:
    """Return whether two views are next to each other and look the same way."""
    near = max(abs(a - b) for a, b in zip(one.state[:2], other.state[:2], strict=True)) <= 1
    same = one.state[2] == other.state[2] and one.horizon_deg == other.horizon_deg
    return near and same
