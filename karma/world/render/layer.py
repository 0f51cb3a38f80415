"""Shoot rays at sets of triangles."""

from collections.abc import Sequence

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from karma.world.render.mesh import Floats, Mesh, joined

LIGHT = np.array([0.38, 0.80, 0.46], dtype=np.float32)  # towards the lamp; length 1
_FLAT = 0.9999
AMBIENT, LAMP, FACING = 0.52, 0.36, 0.18


class Layer:
    """A set of objects as one Embree scene, with a colour and an owner for each triangle."""

    def __init__(
        self, owners: Sequence[str | int], meshes: Sequence[Mesh], before: "Layer | None" = None
    ) -> None:
        """Build the scene.

        Args:
            owners: for each mesh the object's id, or the row of what is no object.
            meshes: their triangles.
            before: a layer whose scene serves again if only colours have changed since.
        """
        whole = joined(meshes)
        self.owners = tuple(owners)
        counts = [len(mesh.faces) for mesh in meshes]
        self.slots = np.repeat(np.arange(len(owners), dtype=np.int32), counts)
        self.colours = np.ascontiguousarray(whole.colours, dtype=np.float32)
        self.glow, self.clear = whole.glow, whole.clear
        self.any_clear = bool(whole.clear.any())
        corners = whole.vertices[whole.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-20)
        self.normals: Floats = (across / length).astype(np.float32)
        self.centres: Floats = _shared(corners.mean(axis=1, dtype=np.float32), self.normals)
        self.low: Floats | None = whole.low if len(whole.faces) else None
        self.high: Floats | None = whole.high if len(whole.faces) else None
        self._vertices, self._faces = whole.vertices, whole.faces
        again = before is not None and self._fits(before)
        self._scene: EmbreeScene = before._scene if before and again else self._built()

    def _fits(self, other: "Layer") -> bool:
        return np.array_equal(self._faces, other._faces) and np.array_equal(
            self._vertices, other._vertices
        )

    def _built(self) -> EmbreeScene:
        scene = EmbreeScene()
        if len(self._faces):
            TriangleMesh(
                scene,
                np.ascontiguousarray(self._vertices, dtype=np.float32),
                np.ascontiguousarray(self._faces, dtype=np.int32),
            )
        return scene

    def __len__(self) -> int:
        return len(self.slots)

    def shot(self, origins: Floats, directions: Floats) -> tuple[Floats, NDArray[np.int32]]:
        """Return for each ray how far it gets and which triangle it meets, -1 = none.

        Args:
            origins: shape (n, 3).
            directions: directions of any length, in which distances count; shape (n, 3).
        """
        if not len(self):
            return np.full(len(directions), np.inf, np.float32), np.full(
                len(directions), -1, np.int32
            )
        found = self._scene.run(origins, directions, output=True)
        return found["tfar"], found["primID"]

    def near(self, origins: Floats, directions: Floats) -> NDArray[np.intp]:
        """Return which rays can meet the ball around all triangles; arguments as `shot`."""
        if self.low is None or self.high is None:
            return np.zeros(0, dtype=np.intp)
        radius = float(np.linalg.norm(self.high - self.low)) / 2 + 1e-3
        gap = (self.low + self.high) / 2 - origins
        ahead = np.einsum("ij,ij->i", gap, directions)
        length = np.einsum("ij,ij->i", directions, directions)
        far = np.einsum("ij,ij->i", gap, gap) - ahead**2 / length
        return np.flatnonzero(far <= np.float32(radius**2))

    def shaded(self, eye: Floats | None, forward: Floats) -> NDArray[np.uint8]:
        """Return each triangle's colour as seen from an eye; None = from far behind.

        Args:
            eye: the camera's place, shape (3,).
            forward: where it looks, shape (3,).
        """
        towards = -forward[None] if eye is None else eye - self.centres
        length = np.sqrt(np.einsum("ij,ij->i", towards, towards)) + np.float32(1e-9)
        facing = np.einsum("ij,ij->i", self.normals, np.broadcast_to(towards, self.normals.shape))
        facing /= length
        lamp = (self.normals @ LIGHT) * np.sign(facing)
        light = AMBIENT + LAMP * np.maximum(lamp, 0.0) + FACING * np.abs(facing)
        light = np.where(self.glow, np.float32(1.0), light)
        return np.minimum(self.colours * light[:, None], 255.0).astype(np.uint8)


def _shared(centres: Floats, normals: Floats) -> Floats:
    """Return one centre for each run of triangles that face the same way: flat stays flat."""
    if not len(centres):
        return centres
    turns = np.einsum("ij,ij->i", normals[1:], normals[:-1]) < _FLAT
    starts = np.concatenate([[0], np.flatnonzero(turns) + 1])
    counts = np.diff(np.concatenate([starts, [len(centres)]]))
    means = np.add.reduceat(centres, starts, axis=0) / counts[:, None]
    return np.repeat(means, counts, axis=0).astype(np.float32)
