"""Measure axis-aligned boxes."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from karma.contracts import Vec3


class Box(NamedTuple):
    """An axis-aligned box by its two corners, metres."""

    x0: float
    y0: float
    z0: float
    x1: float
    y1: float
    z1: float

    @classmethod
    def around(cls, center: Vec3, size: Vec3) -> "Box":
        """Return the box with this centre and size."""
        low = [c - s / 2 for c, s in zip(center, size, strict=True)]
        return cls(*low, *(a + s for a, s in zip(low, size, strict=True)))

    @classmethod
    def hull(cls, boxes: Iterable["Box"]) -> "Box":
        """Return the smallest box round some others, at least one."""
        x0, y0, z0, x1, y1, z1 = zip(*boxes, strict=True)
        return cls(min(x0), min(y0), min(z0), max(x1), max(y1), max(z1))

    @property
    def center(self) -> Vec3:
        """The middle of the box."""
        return ((self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2, (self.z0 + self.z1) / 2)

    @property
    def size(self) -> Vec3:
        """The sides of the box."""
        return (self.x1 - self.x0, self.y1 - self.y0, self.z1 - self.z0)

    def grown(self, x: float, y: float, z: float) -> "Box":
        """Return the box moved outwards on all sides."""
        return Box(
            self.x0 - x, self.y0 - y, self.z0 - z, self.x1 + x, self.y1 + y, self.z1 + z
        )  # fmt: skip

    def shifted(self, x: float, z: float) -> "Box":
        """Return the box moved across the floor."""
        return Box(self.x0 + x, self.y0, self.z0 + z, self.x1 + x, self.y1, self.z1 + z)

    def overlaps(self, other: "Box", slack: float = 1e-6) -> bool:
        """Return whether the two share more than a face."""
        return (
            self.x0 + slack < other.x1 and other.x0 + slack < self.x1
            and self.z0 + slack < other.z1 and other.z0 + slack < self.z1
            and self.y0 + slack < other.y1 and other.y0 + slack < self.y1
        )  # fmt: skip

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the distance of a point from the box; 0 inside."""
        dx = max(self.x0 - x, x - self.x1, 0.0)
        dy = max(self.y0 - y, y - self.y1, 0.0)
        dz = max(self.z0 - z, z - self.z1, 0.0)
        return float((dx * dx + dy * dy + dz * dz) ** 0.5)


def rounded(values: Sequence[float]) -> Vec3:
    """Return a place or size in tenths of a millimetre, as scenes have them; no negative zero."""
    x, y, z = (round(float(value), 4) + 0.0 for value in values)
    return (x, y, z)
