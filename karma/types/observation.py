"""What the agent observes, and the true state of a scene."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from karma.types.space import CameraPose, Frame, Point, Pose, Region, Vec3

State = Literal[
    "heated", "cooked", "sliced", "cleaned", "dirty", "filled",
    "used up", "off", "on", "opened", "closed", "none",
]  # the 12 words of KARMA Fig. 10  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenObject:
    """One object in view, as the simulator's own detector labels it (KARMA §4.1)."""

    object_id: str
    object_type: str
    position_m: Vec3
    box_center_m: Vec3
    box_size_m: Vec3
    pickupable: bool
    parent_ids: tuple[str, ...] = ()
    states: tuple[str, ...] = ()  # words of `State`, sorted; () when nothing was read
    controls: tuple[str, ...] = ()  # ids of what it switches: a knob's burner
    region: Region | None = None  # where its box is in the frame it was seen in
    silhouette: tuple[Point, ...] = ()  # corners of its box there, pixels, may reach out of it

    @property
    def is_somewhere(self) -> bool:
        """Whether its place is a number in all directions: a camera may tell none."""
        return all(map(isfinite, (*self.position_m, *self.box_center_m, *self.box_size_m)))


ReasonKind = Literal[
    "open", "on", "closed", "held", "broken", "empty", "full", "misplaced", "unreached", "other",
    "pickupable", "openable", "toggleable", "breakable", "sliceable", "canFillWithLiquid",
]  # how a thing is that must not be so; or the capability that it lacks  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why the world refused an action."""

    words: str  # the world's, without what no planner can use (stack, asset hashes)
    kind: ReasonKind
    elsewhere: bool = False  # standing elsewhere may help


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What the agent knows after one action: what is in view or was touched, never more."""

    pose: Pose
    camera: CameraPose
    seen: tuple[SeenObject, ...]  # in view, without what is held
    held: SeenObject | None
    reachable: frozenset[str]  # ids in view that an arm can get at: not behind glass
    reason: Reason | None = None  # why the last action did not happen; None: it did
    touched: tuple[SeenObject, ...] = ()  # out of view, but just acted on
    pieces: tuple[SeenObject, ...] = ()  # what a touched thing was just cut into
    washed: frozenset[str] = frozenset()  # known ids that a tap just turned on has washed
    heated: frozenset[str] = frozenset()  # known ids that are hot after something was switched on
    cooled: frozenset[str] = frozenset()  # known ids in a fridge that was just shut
    render: Callable[[], Frame | None] = field(default=lambda: None, compare=False, repr=False)
    look_at: Callable[[SeenObject], tuple[str, ...]] = field(
        default=lambda seen: seen.states, compare=False, repr=False
    )  # states of something in view or held; a picture is read when this is asked


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueObject(SeenObject):
    """One object as it is, seen or not."""

    distance_m: float
    visible: bool
    child_ids: tuple[str, ...]  # what lies in or on it
    receptacle: bool
    openable: bool
    dirtyable: bool
    broken: bool
    temperature: str  # "Hot", "Cold" or "RoomTemp"


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The whole scene after one action: for the judge of goals, the expert and the benchmark only.

    `washed`, `heated` and `cooled` say what the last action did, by ids.
    """

    objects: tuple[TrueObject, ...]
    held_ids: frozenset[str]
    washed: frozenset[str]
    heated: frozenset[str]
    cooled: frozenset[str]
