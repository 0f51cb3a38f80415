"""Perception by pictures: boxes of masks or of a detector, depth, a vision model."""

from functools import cache

from karma import registry
from karma.errors import KarmaError
from karma.plugins.vision.detected import Detector, TrackedBoxes
from karma.plugins.vision.picture_eyes import GivenBoxes, PictureEyes
from karma.types.roles import VisionModel


class PicturePerception:
    """The eyes of one episode, a pair for each room.

    `detector` is a name in `karma.detectors`; without it, boxes are the simulator's.

    Raises:
        KarmaError: detected boxes have no true states that a vision model could tell.
    """

    def __init__(self, vision: VisionModel, detector: str = "") -> None:
        if detector and vision.name == "metadata":
            raise KarmaError(
                "vision = 'metadata' tells the states of given boxes, not of detected ones"
            )
        self._vision, self._detector = vision, detector
        self._eyes: dict[str, PictureEyes] = {}  # by the room's name

    def eyes(self, room: str, instruction: str) -> PictureEyes:
        """Return the eyes for a room and an instruction."""
        if room not in self._eyes:
            self._eyes[room] = self.fresh()
        eyes = self._eyes[room]
        eyes.task = instruction
        return eyes

    def fresh(self) -> PictureEyes:
        """Return eyes that have seen nothing yet."""
        boxes = TrackedBoxes(_loaded(self._detector)) if self._detector else GivenBoxes()
        return PictureEyes(self._vision, boxes)

    def map_file(self, room: str, seed: int) -> str | None:
        """Return the file name of a room's map; None for initial states other than the first.

        So the map is the same whichever episode comes first.
        """
        return None if seed else f"{room}.{'detector' if self._detector else 'given'}.json"


@cache
def _loaded(name: str) -> Detector:
    made: Detector = registry.load("detectors", name)()
    return made
