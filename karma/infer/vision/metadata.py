"""Answer without a picture: repeat the simulator's metadata, or see nothing."""

from collections.abc import Mapping, Sequence

from karma.contracts import Frame, SeenObject


class MetadataVision:
    """A `VisionModel` that returns each object's own `states`, i.e. a reader without error."""

    name = "metadata"
    needs_pictures = False

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> its states; picture and instruction are not looked at."""
        return {seen.object_id: seen.states for seen in objects}


class BlindVision:
    """A `VisionModel` that reads no state of anything: what a reader of pictures must better."""

    name = "blind"
    needs_pictures = False

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return nothing, whatever is asked."""
        return {}
