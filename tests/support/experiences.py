"""What skills have seen and done, made up, and an embedder without weights."""

import hashlib

import numpy as np

from karma.contracts import Experience, SeenObject


def experience(*sights, held=None, handled=(), missed=(), cut=(), effects=None):
    """Things seen in this order; `held` and the others by id."""
    seen = {one.object_id: one for one in sights}
    return Experience(
        seen=seen, views={}, held=seen.get(held), handled_ids=tuple(handled),
        effects=effects or {}, missed=frozenset(missed), cut=frozenset(cut),
    )  # fmt: skip


class Words:
    """An embedder of words: texts that share words are near each other."""

    name, dimension = "words", 64

    def embed(self, texts):
        rows = np.full((len(texts), self.dimension), 0.01, dtype=np.float32)
        for row, text in zip(rows, texts, strict=True):
            for word in text.lower().split():
                row[hashlib.blake2b(word.encode(), digest_size=1).digest()[0] % 64] += 1
        return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def sight(kind, x=1.0, states=(), parents=()):
    """A thing that can be picked up, x metres away."""
    at = (x, 1.0, 0.0)
    return SeenObject(
        object_id=f"{kind}|{x}", object_type=kind, position_m=at, box_center_m=at,
        box_size_m=(0.1, 0.1, 0.1), pickupable=True, states=states, parent_ids=parents,
    )  # fmt: skip
