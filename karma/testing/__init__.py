"""For tests of what is built on this package, without weights: models that cost nothing.

Tiny models of random weights, in the architectures and formats of real ones, load, chat, plan and
look as those do; stand-ins answer what they were told to. Fixtures: `karma.testing.plugin`.
"""

from collections.abc import Mapping, Sequence
from hashlib import blake2b

import numpy as np

from karma.models.scripted import ScriptedModel
from karma.testing.families import FAMILIES, PICTURE_FAMILIES, Size
from karma.testing.models import MadePair, make_picture_model, make_planner
from karma.types.observation import SeenObject
from karma.types.space import Frame, Vectors

__all__ = [
    "FAMILIES",
    "PICTURE_FAMILIES",
    "MadePair",
    "ScriptedModel",
    "Size",
    "StubEmbedder",
    "StubVision",
    "make_picture_model",
    "make_planner",
]


class StubEmbedder:
    """An `Embedder` that counts words: texts with more words in common are nearer.

    Attributes:
        asked: the texts it was given, in order.
    """

    name = "stub"

    def __init__(self, dimension: int = 64) -> None:
        self.dimension = dimension
        self.asked: list[str] = []

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0."""
        self.asked += texts
        rows = np.zeros((len(texts), self.dimension), dtype=np.float32)
        for row, text in zip(rows, texts, strict=True):
            row[0] = 1e-3  # a text without words has a direction too
            for word in text.lower().split():
                row[int.from_bytes(blake2b(word.encode(), digest_size=4).digest()) % len(row)] += 1
            row /= np.linalg.norm(row)
        return rows


class StubVision:
    """A `VisionModel` that reads what it was told beforehand, by type of object.

    `states`: object type -> its states, e.g. {"Mug": ("dirty",)}; other objects have none.

    Attributes:
        asked: the types it was shown, in order.
    """

    name = "stub"
    needs_pictures = False

    def __init__(self, states: Mapping[str, tuple[str, ...]] | None = None) -> None:
        self._states = dict(states or {})
        self.asked: list[str] = []

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> its type's states."""
        self.asked += [one.object_type for one in objects]
        return {one.object_id: self._states.get(one.object_type, ()) for one in objects}
