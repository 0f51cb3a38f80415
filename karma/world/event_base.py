"""Stand in for `ai2thor.server.Event` where that package is not installed.

Only what the embedded world's events need of it: the attributes of a picture with instance
segmentation. The mappings are computed when asked for, as AI2-THOR's are.
"""

from collections.abc import Iterator, Mapping
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


class InstanceMasks(Mapping[str, Mask]):
    """Object id -> where it is in the picture, shape (height, width)."""

    def __init__(self, codes: NDArray[Any], colors: Mapping[str, tuple[int, int, int]]) -> None:
        self.codes = codes
        shown = set(np.unique(codes).tolist())
        self.names = {name: code(color) for name, color in colors.items() if code(color) in shown}
        self.all_codes = frozenset(code(color) for color in colors.values())

    def __getitem__(self, name: str) -> Mask:
        if not is_id(name):
            raise KeyError(name)
        found: Mask = self.codes == self.names[name]
        return found

    def __iter__(self) -> Iterator[str]:
        return (name for name in self.names if is_id(name))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def mask(self, name: str, default: Mask | None = None) -> Mask | None:
        """Return one mask, or the default when it is not in the picture."""
        return self.get(name, default)


class ClassMasks(Mapping[str, Mask]):
    """Type -> where any of them is; "background" is what has no name."""

    def __init__(self, instances: InstanceMasks) -> None:
        self.instances = instances
        self.codes: dict[str, list[int]] = {}
        for name, value in instances.names.items():
            self.codes.setdefault(root_type(name), []).append(value)

    def __getitem__(self, name: str) -> Mask:
        codes = self.instances.codes
        if name == "background":
            found: Mask = ~np.isin(codes, sorted(self.instances.all_codes))
            if found.any():
                return found
        return np.isin(codes, self.codes[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.codes)

    def __len__(self) -> int:
        return len(self.codes)


class InstanceBoxes(Mapping[str, Box]):
    """Object id -> its box in the picture."""

    def __init__(self, masks: InstanceMasks) -> None:
        self.masks = masks

    def __getitem__(self, name: str) -> Box:
        return box_of(self.masks[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.masks)

    def __len__(self) -> int:
        return len(self.masks)


class ClassBoxes(Mapping[str, tuple[Box, ...]]):
    """Type -> the boxes of all of them."""

    def __init__(self, masks: InstanceMasks) -> None:
        self.masks = masks
        self.codes = ClassMasks(masks).codes

    def __getitem__(self, name: str) -> tuple[Box, ...]:
        return tuple(box_of(self.masks.codes == value) for value in self.codes[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.codes)

    def __len__(self) -> int:
        return len(self.codes)


def code(color: tuple[int, int, int]) -> int:
    """Return a colour as one number."""
    red, green, blue = color
    return red | green << 8 | blue << 16


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
        colors = {r["name"]: tuple(r["color"]) for r in self.metadata["colors"]}  # type: ignore[attr-defined]
        self.instance_masks = InstanceMasks(codes, colors)
        self.class_masks = ClassMasks(self.instance_masks)
        self.instance_detections2D = InstanceBoxes(self.instance_masks)
        self.class_detections2D = ClassBoxes(self.instance_masks)
