"""The vision model that needs no picture: it repeats what the simulator's metadata says."""

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
