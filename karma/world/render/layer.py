"""Cast a camera's rays, one for each pixel, and shoot them at sets of triangles."""

from collections.abc import Sequence
from functools import lru_cache
from math import radians, tan
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from karma.world.core.state import Camera
from karma.world.core.thing import heading
from karma.world.core.view import camera_axes
from karma.world.render.device import device
from karma.world.render.mesh import Floats, Mesh, joined

LIGHT = np.array([0.38, 0.80, 0.46], dtype=np.float32)  # towards the lamp; length 1
_FLAT = 0.9999
AMBIENT, LAMP, FACING = 0.52, 0.36, 0.18


class Layer:
    """A set of objects as one Embree scene, with a colour and an owner for each triangle."""

    def __init__(
        self, owners: Sequence[str | int], meshes: Sequence[Mesh], before: "Layer | None" = None
    ) -> None:
        """Build the scene; an owner is an object's id, or the row of what is no object.

        The scene of the layer `before` serves again if only colours have changed since.
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
        self._vertices, self._faces = whole.vertices, whole.faces
        again = before is not None and self._fits(before)
        self._scene: EmbreeScene = before._scene if before and again else self._built()

    def _fits(self, other: "Layer") -> bool:
        return np.array_equal(self._faces, other._faces) and np.array_equal(
            self._vertices, other._vertices
        )

    def _built(self) -> EmbreeScene:
        scene = EmbreeScene(device())
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

        Both arguments have shape (n, 3); distances count in lengths of the directions.
        """
        if not len(self):
            return np.full(len(directions), np.inf, np.float32), np.full(
                len(directions), -1, np.int32
            )
        found = self._scene.run(origins, directions, output=True)
        return found["tfar"], found["primID"]

    def shaded(self, eye: Floats) -> NDArray[np.uint8]:
        """Return each triangle's colour as seen from an eye, shape (3,)."""
        towards = eye - self.centres
        length = np.sqrt(np.einsum("ij,ij->i", towards, towards)) + np.float32(1e-9)
        facing = np.einsum("ij,ij->i", self.normals, towards)
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


# ------------------------------------------------------------------ rays


class Rays(NamedTuple):
    """Where rays start and point; a ray's length along the view is 1, so distances are depths."""

    origins: Floats  # (n, 3), on the near plane or further
    directions: Floats  # (n, 3)
    steps: Floats  # (3, n): the directions again, each part in one piece
    passed: Floats  # (n,): how far from the eye the origins are
    forward: Floats  # (3,)
    eye: Floats  # (3,), where all meet

    def beyond(self, pixels: NDArray[np.intp], far: Floats) -> "Rays":
        """Return some of the rays from further along."""
        directions = self.directions[pixels]
        return self._replace(
            origins=self.origins[pixels] + directions * far[:, None],
            directions=directions,
            steps=self.steps[:, pixels],
            passed=self.passed[pixels] + far,
        )


def rays(view: Camera, width: int, height: int) -> Rays:
    """Return the rays of a camera's pixels, row by row."""
    axes = _axes(view)
    eye = np.array(view.position_m, dtype=np.float32)
    near = np.float32(view.near_m)
    plane, across = _plane(width, height, tan(radians(view.fov_deg) / 2))
    directions = plane @ axes
    passed = np.full(len(plane), near)
    return Rays(eye + directions * near, directions, axes.T @ across, passed, axes[2], eye)


def _axes(view: Camera) -> Floats:
    """Return the rows right, up and forward, shape (3, 3)."""
    pitch, yaw, roll = view.rotation_deg
    right, up, forward = camera_axes(yaw, pitch)
    if roll % 360:
        sine, cosine = heading(roll)
        right, up = cosine * right + sine * up, cosine * up - sine * right
    return np.array([right, up, forward], dtype=np.float32)


@lru_cache(maxsize=8)
def _plane(width: int, height: int, reach: float) -> tuple[Floats, Floats]:
    """Return each pixel's (right, up, 1), shapes (n, 3) and (3, n); up reaches to `reach`."""
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * reach * (width / height)
    y = (1 - (np.arange(height) + 0.5) / height * 2) * reach
    plane = np.empty((height, width, 3), dtype=np.float32)
    plane[..., 0], plane[..., 1], plane[..., 2] = x[None], y[:, None], 1.0
    flat = plane.reshape(-1, 3)
    across = np.ascontiguousarray(flat.T)
    flat.setflags(write=False)
    across.setflags(write=False)
    return flat, across
