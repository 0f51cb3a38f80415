"""What went on in a home, written down while it is lived in; nothing else is touched by that."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from karma.contracts import Pose, Vec3
from karma.plugins.homes.lived.body import HomeRobot
from karma.plugins.homes.lived.request import LivedRequest, ServedRequest
from karma.plugins.homes.memory.setting import KnownPlace
from karma.plugins.homes.residents import Household, Resident
from karma.plugins.homes.types import Deed, Fact, HomeAnswer, HomeMoment, Sighting
from karma.world.core.objects import Objects
from karma.world.core.scene import Scene
from karma.world.core.thing import is_inert

ROBOT = "robot"


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedThing:
    """Where a movable thing is from a time on."""

    time_s: float
    object_id: str
    object_type: str
    center_m: Vec3 | None  # None: in somebody's hand, or used up
    holder: str = ""  # a resident, or the robot


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedDeed:
    """A line of the household's log, and where it was done."""

    deed: Deed
    at_m: Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedWalk:
    """One walk of the robot, by the shortest way."""

    begun_s: float
    over_s: float
    start: Pose
    end: Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedLook:
    """What the robot saw at one time."""

    time_s: float
    seen: tuple[str, ...]  # ids
    looked_over: tuple[str, ...]  # ids of furniture


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedRequest:
    """A request, what memory believed, and the truth of that time."""

    request: LivedRequest
    over_s: float
    truth: tuple[Sighting, ...]  # of what is meant, when it was asked
    went_by: tuple[Fact, ...]  # what memory said, in the order of use
    answer: HomeAnswer
    served: ServedRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeTrace:
    """A home from its first midnight on, as it was lived in."""

    scene: Scene
    places: Mapping[str, KnownPlace]
    residents: tuple[Resident, ...]
    rooms: Mapping[str, str]  # in which residents are at first
    start: Pose  # of the robot
    things: list[TracedThing]  # first where each is at first, then changes
    deeds: list[TracedDeed]
    walks: list[TracedWalk]
    looks: list[TracedLook]
    requests: list[TracedRequest]


class HomeTracer:
    """Writes down what goes on in one home into its `trace`; see `HomeLife`."""

    def enter(self, scene: Scene, household: Household, robot: HomeRobot) -> None:
        """Begin, before anything has happened."""
        self.trace = HomeTrace(
            scene=scene, places=robot.map.places, residents=household.residents,
            rooms={one.name: household.room_of(one.name) for one in household.residents},
            start=household.world.state.pose,
            things=[], deeds=[], walks=[], looks=[], requests=[],
        )  # fmt: skip
        self._now: dict[str, TracedThing] = {}
        self._objects: Objects | None = None
        self._held: frozenset[str] = frozenset()
        self.follow(household, robot)
        self._note_things(0.0)

    def follow(self, household: Household, robot: HomeRobot) -> None:
        """Go on with a fork of the home."""
        self._household = household
        household.watch, robot.watch = self._changed, self._walked

    def learnt(self, moment: HomeMoment) -> None:
        """Write down a look; deeds are in the log."""
        if moment.deed is None:
            self.trace.looks.append(
                TracedLook(
                    time_s=moment.time_s,
                    seen=tuple(one.object_id for one in moment.seen),
                    looked_over=moment.looked_over,
                )
            )

    def served(
        self, request: LivedRequest, truth: Mapping[str, Sighting], went_by: Sequence[Fact],
        answer: HomeAnswer, served: ServedRequest,
    ) -> None:  # fmt: skip
        """Write down a request with what came of it; the truth is of when it was asked."""
        self.trace.requests.append(
            TracedRequest(
                request=request,
                over_s=self._household.clock_s,
                truth=tuple(truth[one] for one in request.object_ids if one in truth),
                went_by=tuple(went_by),
                answer=answer,
                served=served,
            )
        )

    # ------------------------------------------------------------- what is shown to it

    def _walked(self, start: Pose, begun_s: float) -> None:
        end, over_s = self._household.world.state.pose, self._household.clock_s
        self.trace.walks.append(TracedWalk(begun_s=begun_s, over_s=over_s, start=start, end=end))

    def _changed(self, deeds: Sequence[Deed]) -> None:
        """Write down deeds, who carries what meanwhile, and where things are afterwards."""
        for deed in deeds:
            self.trace.deeds.append(TracedDeed(deed=deed, at_m=self._place_of(deed)))
            if deed.action == "PickupObject" and deed.who != ROBOT:
                self._note(deed.object_id, deed.object_type, deed.time_s, None, deed.who)
        self._note_things(deeds[-1].time_s if deeds else self._household.clock_s)

    def _place_of(self, deed: Deed) -> Vec3:
        """Return where a deed was done: before a thing is put down, where it was taken."""
        before = self._now.get(deed.object_id)
        if deed.action != "PutObject" and before is not None and before.center_m is not None:
            return before.center_m
        if deed.action != "PutObject" and before is not None and self.trace.deeds:
            return self.trace.deeds[-1].at_m
        return self._household.world.state.objects[deed.object_id].center

    def _note_things(self, time_s: float) -> None:
        state = self._household.world.state
        if state.objects is self._objects and self._held == state.in_hand:
            return
        self._objects, self._held = state.objects, state.in_hand
        there = set()
        for one in state.objects.values():
            if "pickupable" in one.capabilities and not is_inert(one):
                there.add(one.id)
                holder = ROBOT if one.id in state.in_hand else ""
                self._note(one.id, one.type, time_s, None if holder else one.center, holder)
        for object_id in sorted(self._now.keys() - there):
            self._note(object_id, self._now[object_id].object_type, time_s, None, "")

    def _note(
        self, object_id: str, object_type: str, time_s: float, center_m: Vec3 | None, holder: str
    ) -> None:
        before = self._now.get(object_id)
        if before is not None and (before.center_m, before.holder) == (center_m, holder):
            return
        self._now[object_id] = TracedThing(
            time_s=time_s, object_id=object_id, object_type=object_type, center_m=center_m,
            holder=holder,
        )  # fmt: skip
        self.trace.things.append(self._now[object_id])
