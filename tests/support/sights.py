"""Objects as a detector labels them, for tests of readers of pictures."""

from karma.contracts import SeenObject

_SOMEWHERE = {"position_m": (0, 0, 0), "box_center_m": (0, 0, 0), "box_size_m": (1, 1, 1)}


def seen(object_id, **more):
    """An object that can be picked up, of the type that its id begins with."""
    fields = {**_SOMEWHERE, "object_type": object_id.partition("|")[0], "pickupable": True, **more}
    return SeenObject(object_id=object_id, **fields)
