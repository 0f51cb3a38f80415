"""What skills have seen and done, made up; an embedder, and episodes, without weights."""

import hashlib

import numpy as np

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.files import to_json
from karma.memory.recall import CosineRecall
from karma.models.scripted import MetadataVision
from karma.types.completion import Decoding
from karma.types.memory import Experience
from karma.types.observation import SeenObject
from karma.types.space import SceneRef
from karma.world.sim import EmbeddedWorld
from support.household import kitchen


def experience(*sights, held=None, handled=(), missed=(), cut=(), effects=None):
    """Things seen in this order; `held` and the others by id."""
    seen = {one.object_id: one for one in sights}
    return Experience(
        seen=seen, views={}, held=seen.get(held), handled_ids=tuple(handled),
        effects=effects or {}, missed=dict.fromkeys(missed, (0.0, 0.0, 0.0)), cut=frozenset(cut),
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


def begun(
    folder, model, *, room=None, profile="compact", decoding=None, recall=None, vision=None,
    maps=None, learn=False, attempts=3, **options,
):  # fmt: skip
    """An episode of KARMA in the kitchen made by hand, or another room's file, and its world."""
    path = folder / "handmade.json"
    path.write_bytes(to_json(room or kitchen()))
    method = KarmaMethod(
        Planner(model, profile, decoding or Decoding(attempts=1)),
        recall or CosineRecall(Words(), text="sentence"), vision or MetadataVision(),
        KarmaSettings(**options), maps=maps, learn=learn, attempts=attempts,
    )  # fmt: skip
    world = EmbeddedWorld(str(path))
    return method.begin(world, SceneRef.of(str(path)), seed=0, folder=folder), world
