"""Build an object's triangles from its form, with what dirt, heat and cold do to any shape."""

from functools import lru_cache
from types import MappingProxyType

import numpy as np

from karma.world.render import cases, dishes, fixtures, food, furniture, machines, things
from karma.world.render.form import Builder, Form
from karma.world.render.mesh import GHOST, Mesh, finer, joined, lathe, mirrored, shifted

_MODULES = (food, dishes, furniture, cases, fixtures, machines, things)
BUILDERS = MappingProxyType(
    {name: builder for module in _MODULES for name, builder in module.BUILDERS.items()}
)
BROWN = np.array([92.0, 62.0, 28.0], dtype=np.float32)
TINTS = {
    "Hot": (np.array([240.0, 70.0, 30.0], dtype=np.float32), 0.32),
    "Cold": (np.array([110.0, 180.0, 255.0], dtype=np.float32), 0.38),
}
_SPOTTED = 600  # faces that patches are drawn over, at least
_KEPT = 256  # shapes, some kilobytes each; shared by all worlds of a process


@lru_cache(maxsize=_KEPT)
def shape(builder: str, form: Form, temperature: str) -> Mesh:
    """Return the triangles of an object, x to the left of its front; never to be written to.

    Args:
        builder: one of `BUILDERS`.
        form: measures, colours, state.
        temperature: RoomTemp, Hot or Cold.
    """
    build: Builder = BUILDERS[builder]
    whole = joined(build(form))
    if form.dirty and builder != "bed":
        whole = _stained(whole)
    if temperature in TINTS:
        whole = _tinted(whole, temperature)
    if temperature == "Hot":
        whole = joined([whole, *_steam(whole)])
    return mirrored(whole)  # x of the builders points the other way than Unity's


def _stained(whole: Mesh) -> Mesh:
    """Return the mesh with brown patches over a good third of it."""
    while len(whole.faces) < _SPOTTED:
        whole = finer(whole)
    span = np.maximum(whole.high - whole.low, 1e-3)
    places = (whole.vertices[whole.faces].mean(axis=1) - whole.low) / span
    x, y, z = places.T
    patches = np.sin(11 * x + 4 * z + 0.6) + np.sin(9 * z - 5 * y + 1.9) + np.sin(8 * y + 3 * x)
    spotted = patches > np.quantile(patches, 0.62)
    colours = np.where(spotted[:, None], BROWN, whole.colours).astype(np.float32)
    return whole._replace(colours=colours)


def _tinted(whole: Mesh, temperature: str) -> Mesh:
    tint, share = TINTS[temperature]
    colours = whole.colours + (tint - whole.colours) * share
    return whole._replace(colours=np.where(whole.glow[:, None], whole.colours, colours))


def _steam(whole: Mesh) -> list[Mesh]:
    """Return three plumes above a hot thing."""
    low, high = whole.low, whole.high
    middle = (low + high) / 2
    wide = float(np.clip((high[0] - low[0]) * 0.12, 0.008, 0.03))
    found = []
    for number, (a, b) in enumerate(((-0.25, 0.0), (0.05, 0.2), (0.28, -0.15))):
        tall = 0.07 + 0.02 * number
        puff = lathe(
            [(0.0, 0.0), (wide, tall * 0.3), (wide * 0.45, tall * 0.55), (wide * 0.9, tall * 0.8),
             (0.0, tall)],
            (250.0, 250.0, 250.0), sides=7, glow=True, clear=GHOST,
        )  # fmt: skip
        x = float(middle[0] + a * (high[0] - low[0]))
        z = float(middle[2] + b * (high[2] - low[2]))
        found.append(shifted(puff, x, float(high[1]) + 0.008, z))
    return found
