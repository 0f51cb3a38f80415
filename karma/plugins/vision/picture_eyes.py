"""Eyes that see by pictures alone.

The agent knows of the world what boxes, depth and a vision model tell it:

* which things are in view: the simulator's own instance masks with types and ids (`GivenBoxes`),
  or a detector's boxes (`detected`);
* where they are and how big: their pixels and the depth there (`depth`);
* in which state: the vision model, asked when somebody wants to know, once per view and thing;
* what lies in what: the boxes, or that the agent put it there itself.

Besides it feels whether its hand is empty, knows where it stands, and hears why an action was
refused, in the world's words: what a robot's arm and wheels would tell.
"""

import math
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from karma.agent.seeing import perceive
from karma.agent.seeing.eyes import nearest
from karma.agent.seeing.projection import region_of, silhouette_of
from karma.household.ids import is_part, type_of
from karma.household.places import FLOOR, HAND
from karma.household.types import Capability, ObjectType, object_types
from karma.household.uses import BURNER, KNOB, MICROWAVE
from karma.household.water import wetted
from karma.plugins.vision.depth import (
    Box,
    Capture,
    box_round,
    gap_m,
    joined,
    pixels_of,
    points_in,
)
from karma.types.observation import Observation, SeenObject
from karma.types.roles import Event, VisionModel
from karma.types.space import CameraPose, Pose, Vec3

REACH_M = 1.5  # across the floor, as AI2-THOR's; what is farther away is left out
LEAST_PIXELS = 16  # of fewer nothing can be said
_MOST_POINTS = 2000  # of one thing, that its box is measured by
_TELLING: frozenset[Capability] = frozenset(
    ("openable", "toggleable", "dirtyable", "canFillWithLiquid", "canBeUsedUp", "cookable",
     "breakable", "sliceable", "pickupable")
)  # a type with none of them has no state that a picture could show  # fmt: skip
_ASIDE_M = 0.05  # how far a thing's centre may be outside what holds it
_ON_M = 0.1  # between the underside of a thing and the top that it stands on


@dataclass(frozen=True, slots=True, kw_only=True)
class Instance:
    """One thing in a picture."""

    object_id: str
    object_type: str
    mask: NDArray[np.bool_] = field(compare=False, repr=False)  # (H, W)


class Boxes(Protocol):
    """What finds things in a picture and gives them names that last."""

    name: str

    def find(self, capture: Capture, camera: CameraPose, held: str | None) -> Iterable[Instance]:
        """Return the things in view, each under the id that it had before."""

    def aim(self, object_id: str) -> Mapping[str, Any]:
        """Return the arguments by which an action means a thing in view."""

    def moved(self, object_id: str, to_m: Vec3) -> None:
        """Take note that the agent put a thing somewhere."""


class GivenBoxes:
    """The simulator's own instance masks: types and ids, no states and no places."""

    name = "given"

    def find(self, capture: Capture, camera: CameraPose, held: str | None) -> Iterator[Instance]:
        """Yield what the masks show."""
        for name, mask in capture.masks.items():
            yield Instance(object_id=name, object_type=type_of(name), mask=mask)

    def aim(self, object_id: str) -> Mapping[str, Any]:
        """Return the thing's id."""
        return {"objectId": object_id}

    def moved(self, object_id: str, to_m: Vec3) -> None:
        """Do nothing: ids stay as they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Look:
    """What one picture shows within reach."""

    event: Event
    capture: Capture
    pose: Pose
    camera: CameraPose
    sights: Mapping[str, SeenObject]


class PictureEyes:
    """Sees by pictures alone; one for each room, as it keeps what it knows of it.

    A vision model that needs no pictures is asked at once, with the true states.
    """

    def __init__(self, vision: VisionModel, boxes: Boxes) -> None:
        self.task = ""  # the instruction, for the vision model
        self._vision, self._boxes = vision, boxes
        self._known: dict[str, SeenObject] = {}  # the latest sight of each id
        self._pixels: dict[str, int] = {}  # of an openable thing, in the look that its box is of
        self._put: dict[str, str] = {}  # what the agent put down, and where
        self._held: str | None = None
        self._last: _Look | None = None

    def aim(self, object_id: str) -> Mapping[str, Any]:
        """Return the arguments by which an action means a thing in view."""
        return self._boxes.aim(object_id)

    def observe(
        self, event: Event, *, touched: Collection[str] = (), known: Container[str] = ()
    ) -> Observation:
        """Return what the agent learns from one action; arguments as in `perceive.observe`."""
        self._feel(event, list(touched))
        look = self._look(event)
        held = self._in_hand(look)
        seen = {name: one for name, one in look.sights.items() if name != self._held}
        gone = [name for name in touched if name not in seen and name != self._held]
        near = {*touched, *look.sights, *filter(None, [self._held])}
        ran = list(touched) if perceive.done(event, "ToggleObjectOn") else []

        def mine(names: Iterable[str]) -> frozenset[str]:
            return frozenset(name for name in names if name in near or name in known)

        return Observation(
            pose=look.pose,
            camera=look.camera,
            seen=tuple(seen.values()),
            held=held,
            reachable=frozenset(seen),
            reason=perceive.refusal(event),
            touched=tuple(self._known[name] for name in gone if name in self._known),
            pieces=self._pieces(event, touched, seen),
            washed=mine(wetted(ran, map(perceive.lying, self._known.values()))),
            heated=mine(self._cooking(ran)),
            render=lambda: look.capture.rgb,
            look_at=self._reader(look),
        )

    # ------------------------------------------------------------- one picture

    def _look(self, event: Event) -> _Look:
        """Return what an event's picture shows; of the same event the same."""
        if self._last is not None and self._last.event is event:
            return replace(self._last, sights=self._supported(self._last.sights))
        capture, camera = pixels_of(event), perceive.camera_of(event)
        pose = perceive.pose_of(event)
        sights = {}
        for found in self._boxes.find(capture, camera, self._held):
            sight = self._sight(found, capture, camera, pose)
            if sight is not None:
                sights[found.object_id] = sight
        self._known.update(sights)
        if not self._vision.needs_pictures:
            sights = self._with_true_states(event, sights)
        self._last = _Look(
            event=event, capture=capture, pose=pose, camera=camera, sights=self._supported(sights)
        )
        return self._last

    def _sight(
        self, found: Instance, capture: Capture, camera: CameraPose, pose: Pose
    ) -> SeenObject | None:
        """Return one thing as its pixels and their depth show it; None if too few or too far."""
        kind = object_types().get(found.object_type)
        points = points_in(capture.depth_m, found.mask, camera)
        if kind is None or found.object_type == FLOOR or len(points) < LEAST_PIXELS:
            return None
        count, points = len(points), points[:: 1 + len(points) // _MOST_POINTS]
        if gap_m(points, pose.position_m) > REACH_M:
            return None
        shown = box_round(points)
        center_m, size_m = self._box(found.object_id, kind, shown, count)
        return SeenObject(
            object_id=found.object_id,
            object_type=found.object_type,
            position_m=center_m,
            box_center_m=center_m,
            box_size_m=size_m,
            pickupable=kind.can("pickupable"),
            region=region_of(camera, *shown),
            silhouette=silhouette_of(camera, *shown),
        )

    def _box(self, name: str, kind: ObjectType, shown: Box, pixels: int) -> Box:
        """Return a thing's box: as it shows now; of what is fixed all that was ever seen of it.

        Of what has a door the look that showed most, before the agent opened it: an open door is
        no part of the box.
        """
        before = self._known.get(name)
        if before is None or kind.can("pickupable"):
            self._pixels[name] = pixels
            return shown
        kept = before.box_center_m, before.box_size_m
        if not kind.can("openable"):
            return joined(kept, shown)
        if pixels <= self._pixels.get(name, 0):
            return kept
        self._pixels[name] = pixels
        return shown

    def _supported(self, sights: Mapping[str, SeenObject]) -> dict[str, SeenObject]:
        """Return sights with what they lie in or on, and what a knob switches."""
        found = {}
        for name, sight in sights.items():
            known = self._known.values()
            place = self._put.get(name) or holder_of(sight, known)
            burner = nearest(sight, BURNER, known) if sight.object_type == KNOB else None
            parents = () if place is None else (place,)
            controls = () if burner is None else (burner.object_id,)
            found[name] = replace(sight, parent_ids=parents, controls=controls)
        self._known.update(found)
        return found

    def _with_true_states(
        self, event: Event, sights: Mapping[str, SeenObject]
    ) -> dict[str, SeenObject]:
        """Return sights with the states that a model without pictures tells."""
        true = perceive.states_in(event)
        asked = [replace(one, states=true.get(name, ())) for name, one in sights.items()]
        told = self._vision.read_states(None, self.task, asked)
        return {one.object_id: replace(one, states=told.get(one.object_id, ())) for one in asked}

    def _reader(self, look: _Look) -> Callable[[SeenObject], tuple[str, ...]]:
        """Return what reads the states of things in one picture, each once."""
        if not self._vision.needs_pictures:
            return lambda seen: seen.states

        @cache
        def read(name: str) -> tuple[str, ...]:
            one = look.sights.get(name)
            if one is None or _TELLING.isdisjoint(object_types()[one.object_type].capabilities):
                return ()
            return self._vision.read_states(look.capture.rgb, self.task, [one]).get(name, ())

        return lambda seen: read(seen.object_id)

    # ------------------------------------------------------------- what was done

    def _feel(self, event: Event, touched: Sequence[str]) -> None:
        """Note what the agent did: took into the hand, put down, or opened."""
        if touched and perceive.done(event, "PickupObject"):
            self._held = touched[0]
            self._put.pop(touched[0], None)
        if len(touched) > 1 and perceive.done(event, "PutObject"):
            self._place(touched[0], touched[1])
        if touched and perceive.done(event, "OpenObject"):
            self._pixels[touched[0]] = 1 << 30  # its box stays as it was with the door closed
        if not perceive.grips(event):
            self._held = None

    def _place(self, thing: str, place: str) -> None:
        """Note that a thing was put somewhere."""
        self._put[thing] = place
        known, there = self._known.get(thing), self._known.get(place)
        if known is not None and there is not None:
            moved = replace(known, position_m=there.position_m, box_center_m=there.box_center_m)
            self._known[thing] = replace(moved, parent_ids=(place,))
            self._boxes.moved(thing, there.box_center_m)

    def _in_hand(self, look: _Look) -> SeenObject | None:
        """Return what is held, as it shows now or was last seen."""
        if self._held is None:
            return None
        sight = look.sights.get(self._held) or self._known.get(self._held)
        if sight is None:
            return None
        return replace(sight, parent_ids=(HAND,), position_m=look.pose.position_m)

    def _pieces(
        self, event: Event, wholes: Collection[str], seen: Mapping[str, SeenObject]
    ) -> tuple[SeenObject, ...]:
        """Return what is seen of a thing that was just cut."""
        if not perceive.done(event, "SliceObject"):
            return ()
        return tuple(one for one in seen.values() if any(is_part(one.object_id, w) for w in wholes))

    def _cooking(self, ran: Sequence[str]) -> frozenset[str]:
        """Return what the agent believes to lie in the microwaves that were just switched on."""
        known = self._known
        ovens = [one for one in ran if one in known and known[one].object_type == MICROWAVE]
        return frozenset(name for oven in ovens for name in contents(oven, known.values()))


def holder_of(thing: SeenObject, others: Iterable[SeenObject]) -> str | None:
    """Return the id of what a thing that can be carried lies on, or else in; None if nothing does.

    Of several tops the nearest below counts, of several boxes round it the smallest.
    """
    kind = object_types().get(thing.object_type)
    if kind is None or not thing.pickupable:
        return None
    on, inside = [], []
    bottom = thing.box_center_m[1] - thing.box_size_m[1] / 2
    for other in others:
        place = object_types()[other.object_type]
        if other.object_id == thing.object_id or not place.can("receptacle"):
            continue
        if not kind.fits(place) or not _over(thing, other):
            continue
        middle, half = other.box_center_m[1], other.box_size_m[1] / 2
        low, high = middle - half, middle + half
        if abs(bottom - high) <= _ON_M:
            on.append((abs(bottom - high), other.object_id))
        elif low - _ASIDE_M <= bottom and thing.box_center_m[1] <= high:
            inside.append((math.prod(other.box_size_m), other.object_id))
    return min(on or inside, default=(0.0, None))[1]


def contents(place: str, things: Iterable[SeenObject]) -> set[str]:
    """Return the ids of what lies in a place, and in that again."""
    things = list(things)
    inside, waiting = set[str](), [place]
    while waiting:
        holder = waiting.pop()
        for thing in things:
            if holder in thing.parent_ids and thing.object_id not in inside:
                inside.add(thing.object_id)
                waiting.append(thing.object_id)
    return inside


def _over(thing: SeenObject, other: SeenObject) -> bool:
    return all(
        abs(thing.box_center_m[axis] - other.box_center_m[axis])
        <= other.box_size_m[axis] / 2 + _ASIDE_M
        for axis in (0, 2)
    )
