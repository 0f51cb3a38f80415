"""How a row of an experiment sees: by metadata, or by pictures with given or detected boxes."""

from typing import Literal

from karma.agent.seeing.eyes import Eyes, GivenBoxes, PictureEyes
from karma.agent.seeing.tracking import TrackedBoxes
from karma.contracts import Detector, Resources, VisionModel
from karma.errors import KarmaError

Kind = Literal["metadata", "pictures"]
BoxSource = Literal["given", "detector"]


class Perception:
    """The eyes of one episode, a pair for each room.

    Without a detector the simulator's boxes are given.
    """

    def __init__(self, kind: Kind, vision: VisionModel, detector: Detector | None) -> None:
        self._kind, self._vision, self._detector = kind, vision, detector
        self._eyes: dict[str, PictureEyes] = {}  # by the room's name

    def eyes(self, room: str, instruction: str) -> Eyes | None:
        """Return the eyes for a room and what is looked for; None: the simulator's metadata."""
        if self._kind == "metadata":
            return None
        if room not in self._eyes:
            self._eyes[room] = self._made()
        eyes = self._eyes[room]
        eyes.task = instruction
        return eyes

    def fresh(self) -> Eyes | None:
        """Return eyes that have seen nothing yet, for the first tour of a room."""
        return None if self._kind == "metadata" else self._made()

    def map_file(self, room: str, seed: int) -> str | None:
        """Return what the map of a room is called; None: it is explored anew.

        A map from pictures is kept of the room as it is only, so that it is the same whichever
        episode comes first.
        """
        if self._kind == "metadata":
            return f"{room}.json"
        return None if seed else f"{room}.{'detector' if self._detector else 'given'}.json"

    def _made(self) -> PictureEyes:
        found = GivenBoxes() if self._detector is None else TrackedBoxes(self._detector)
        return PictureEyes(self._vision, found)


def detector_of(kind: Kind, boxes: BoxSource, resources: Resources) -> Detector | None:
    """Return the detector that a row sees by, None for none needed; KarmaError for none loaded."""
    if kind == "metadata" or boxes == "given":
        if boxes == "detector":
            raise KarmaError("boxes = 'detector' goes with perception = 'pictures'")
        return None
    if resources.detector is None:
        raise KarmaError(
            "boxes = 'detector', and no detector is loaded\n"
            '  To fix: boxes = "given", or a plug-in of karma.detectors as detector in [models]'
        )
    if resources.vision.name == "metadata":
        raise KarmaError(
            "vision = 'metadata' tells the states of given boxes, not of detected ones"
        )
    return resources.detector
