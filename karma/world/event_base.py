"""Stand in for `ai2thor.server.Event` where that package is not installed.

Only what the embedded world's events need of it: the attributes of a picture with instance
segmentation.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.household.ids import is_id, root_type

Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]  # first and last column and row: x0, y0, x1, y1


class MetadataWrapper(dict[str, Any]):
    """A dict with AI2-THOR's two aliases."""

    def __getitem__(self, key: str) -> Any:
        if key == "hand" and key not in self:
            key = "heldObjectPose"
        elif key == "reachablePositions":
            if super().__getitem__("lastAction") != "GetReachablePositions":
                raise IndexError("reachablePositions is only known after GetReachablePositions")
            key = "actionReturn"
        return super().__getitem__(key)


def box_of(mask: Mask) -> Box:
    """Return first and last column and row of what a mask, not empty, covers."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    return int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])


class SegmentedEvent:
    """The part of AI2-THOR's event that reads instance segmentation."""

    def process_colors_ids(self, image_ids_data: bytes) -> None:
        """Set masks and boxes from a picture of RGBA colours, bottom row first."""
        height = self.screen_height  # type: ignore[attr-defined]
        codes = np.frombuffer(image_ids_data, dtype="<u4").reshape(height, -1)[::-1] & 0xFFFFFF
        visible = set(np.unique(codes).tolist())
        masks: dict[str, Mask] = {}
        types: dict[str, list[Mask]] = {}
        for row in self.metadata["colors"]:  # type: ignore[attr-defined]
            red, green, blue = row["color"]
            code = red | green << 8 | blue << 16
            if code in visible:
                masks[row["name"]] = codes == code
                types.setdefault(root_type(row["name"]), []).append(codes == code)
        self.instance_masks = {name: mask for name, mask in masks.items() if is_id(name)}
        self.class_masks = {kind: np.any(parts, axis=0) for kind, parts in types.items()}
        self.instance_detections2D = {k: box_of(mask) for k, mask in self.instance_masks.items()}
        self.class_detections2D = {k: tuple(map(box_of, parts)) for k, parts in types.items()}
