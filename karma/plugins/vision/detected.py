"""Boxes of a detector, a plug-in of `karma.detectors`.

A detector says "a mug, here, this sure" anew in every picture. A name is made as the simulator's
are, of the type and where it was first seen; a thing of that type near where one was before is that
one. So a thing that somebody else moved far away gets a new name, and two that change places keep
each other's.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.plugins.vision.depth import Capture, box_round, core_of, points_in
from karma.plugins.vision.picture_eyes import LEAST_PIXELS, Instance
from karma.types.space import CameraPose, Frame, Region, Vec3

WORDS_PER_TURN = 20  # a detector's context holds some 80
SAME_M = 0.4  # between two looks at one thing, whose sides one sees differently
IN_HAND_M = 0.8  # from the camera
_SAME_REGION = 0.7  # share of two regions in common, from which on they are of one thing
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """One thing that a detector found in a picture."""

    label: str  # one of the words that were asked for
    score: float  # in [0, 1]
    box_px: Region
    mask: NDArray[np.bool_] | None = field(default=None, compare=False, repr=False)  # (H, W)


class Detector(Protocol):
    """Finds things in a picture by their names: the eyes of a robot without a simulator."""

    name: str

    def detect(self, image: Frame, words: Sequence[str]) -> Sequence[Detection]:
        """Return what was found, the best score first; labels are of the words."""


@cache
def words_by_type() -> Mapping[str, str]:
    """Return word -> type for all of a household's types, as a detector is asked for them.

    >>> words_by_type()["coffee machine"]
    'CoffeeMachine'
    """
    names = (name for name in object_types() if name != FLOOR)
    return {" ".join(_WORD.findall(name)).lower(): name for name in names}


class TrackedBoxes:
    """A detector's boxes, of which each thing keeps its name from look to look."""

    def __init__(self, detector: Detector) -> None:
        self.name = detector.name
        self._detector = detector
        self._places: dict[str, tuple[str, Vec3]] = {}  # id -> type, where it was seen last
        self._aims: dict[str, Mapping[str, Any]] = {}  # of the last picture

    def find(self, capture: Capture, camera: CameraPose, held: str | None) -> Iterator[Instance]:
        """Yield what the detector finds, each under the name that it had before."""
        self._aims = {}
        height, width = capture.depth_m.shape
        for found in self._detected(capture):
            mask = core_of(found.box_px, height, width) if found.mask is None else found.mask
            if mask.sum() < LEAST_PIXELS:
                continue
            kind = words_by_type()[found.label]
            center_m, _ = box_round(points_in(capture.depth_m, mask, camera))
            name = self._name(kind, center_m, camera, held)
            self._places[name] = kind, center_m
            self._aims[name] = _middle(mask)
            yield Instance(object_id=name, object_type=kind, mask=mask)

    def aim(self, object_id: str) -> Mapping[str, Any]:
        """Return the place in the last picture that the action is aimed at.

        What is not in that picture is named by an id that no world knows, and so refused.
        """
        return self._aims.get(object_id, {"objectId": object_id})

    def moved(self, object_id: str, to_m: Vec3) -> None:
        """Take note that the agent put a thing somewhere."""
        if object_id in self._places:
            self._places[object_id] = self._places[object_id][0], to_m

    def _detected(self, capture: Capture) -> list[Detection]:
        """Return the detections of all words, the best first; of one region only the best."""
        words = list(words_by_type())
        turns = [words[i : i + WORDS_PER_TURN] for i in range(0, len(words), WORDS_PER_TURN)]
        found = [one for turn in turns for one in self._detector.detect(capture.rgb, turn)]
        found.sort(key=lambda one: (-one.score, one.box_px, one.label))
        kept: list[Detection] = []
        for one in found:
            if all(_common(one.box_px, other.box_px) < _SAME_REGION for other in kept):
                kept.append(one)
        return kept

    def _name(self, kind: str, center_m: Vec3, camera: CameraPose, held: str | None) -> str:
        """Return the name of a thing seen somewhere; one name stands for one thing per picture."""
        in_hand = math.dist(center_m, camera.position_m) < IN_HAND_M
        if in_hand and held is not None and self._is_free(held, kind):
            return held
        near = [
            (math.dist(center_m, place_m), name)
            for name, (_, place_m) in self._places.items()
            if name != held and self._is_free(name, kind)
        ]
        gap_m, name = min(near, default=(math.inf, ""))
        if gap_m <= SAME_M:
            return name
        return _new_name(kind, center_m, self._places)

    def _is_free(self, name: str, kind: str) -> bool:
        """Return whether a name is of that type and not given away in this picture."""
        return name in self._places and self._places[name][0] == kind and name not in self._aims


def _new_name(kind: str, center_m: Vec3, taken: Mapping[str, object]) -> str:
    x, y, z = center_m
    name = f"{kind}|{x:+06.2f}|{y:+06.2f}|{z:+06.2f}"
    count = 1
    while name in taken:
        count += 1
        name = f"{kind}|{x:+06.2f}|{y:+06.2f}|{z:+06.2f}_{count}"
    return name


def _middle(mask: NDArray[np.bool_]) -> dict[str, float]:
    """Return the pixel of a mask nearest to its middle, from the top left, in [0, 1]."""
    rows, columns = np.nonzero(mask)
    nearest = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
    height, width = mask.shape
    return {"x": (columns[nearest] + 0.5) / width, "y": (rows[nearest] + 0.5) / height}


def _common(one: Region, other: Region) -> float:
    """Return the share of two regions that they have in common, in [0, 1]."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    high = min(one[3], other[3]) - max(one[1], other[1])
    if wide <= 0 or high <= 0:
        return 0.0
    both = wide * high
    return both / (_area(one) + _area(other) - both)


def _area(region: Region) -> float:
    return (region[2] - region[0]) * (region[3] - region[1])
