"""Objects as a detector labels them, and questions, for tests of readers of pictures."""

from karma.models.picture_questions import picture_url
from karma.types.observation import SeenObject

_SOMEWHERE = {"position_m": (0, 0, 0), "box_center_m": (0, 0, 0), "box_size_m": (1, 1, 1)}


def seen(object_id, **more):
    """An object that can be picked up, of the type that its id begins with."""
    fields = {**_SOMEWHERE, "object_type": object_id.partition("|")[0], "pickupable": True, **more}
    return SeenObject(object_id=object_id, **fields)


def about(frame):
    """A conversation that asks what is in a picture."""
    parts = [
        {"type": "image_url", "image_url": {"url": picture_url(frame)}},
        {"type": "text", "text": "What is there?"},
    ]
    return [{"role": "user", "content": parts}]
