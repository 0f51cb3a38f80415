"""Stand in for `ai2thor.server.Event` where that package is not installed.

Only what the embedded world's events need of it: the attributes of a picture with instance
segmentation. The mappings are computed when asked for, as AI2-THOR's are.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from karma.household.ids import is_id, root_type

T = TypeVar("T")
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


class Lazy(Mapping[str, T]):
    """Values by their keys in order, that are worked out each time they are asked for."""

    def __init__(self, keys: Collection[str], make: Callable[[str], T]) -> None:
        self._keys, self._make = keys, make

    def __getitem__(self, name: str) -> T:
        if name not in self._keys:
            raise KeyError(name)
        return self._make(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


class InstanceMasks(Lazy[Mask]):
    """Object id -> where it is in the picture, shape (height, width)."""

    def __init__(self, codes: NDArray[Any], colors: Mapping[str, tuple[int, int, int]]) -> None:
        self.codes = codes
        shown = set(np.unique(codes).tolist())
        self.names = {name: code(color) for name, color in colors.items() if code(color) in shown}
        self.all_codes = frozenset(code(color) for color in colors.values())
        super().__init__(
            [name for name in self.names if is_id(name)], lambda name: codes == self.names[name]
        )

    def mask(self, name: str, default: Mask | None = None) -> Mask | None:
        """Return one mask, or the default when it is not in the picture."""
        return self.get(name, default)


class ClassMasks(Lazy[Mask]):
    """Type -> where any of them is; "background" is what has no name."""

    def __init__(self, instances: InstanceMasks) -> None:
        self.instances = instances
        self.codes: dict[str, list[int]] = {}
        for name, value in instances.names.items():
            self.codes.setdefault(root_type(name), []).append(value)
        super().__init__(self.codes, lambda name: np.isin(instances.codes, self.codes[name]))

    def __getitem__(self, name: str) -> Mask:
        if name == "background":
            found: Mask = ~np.isin(self.instances.codes, sorted(self.instances.all_codes))
            if found.any():
                return found
        return super().__getitem__(name)


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
        masks = InstanceMasks(codes, colors)
        types = ClassMasks(masks)
        self.instance_masks, self.class_masks = masks, types
        self.instance_detections2D = Lazy(masks, lambda name: box_of(masks[name]))
        self.class_detections2D = Lazy(
            types.codes, lambda name: tuple(box_of(codes == value) for value in types.codes[name])
        )
