"""One seed at the edge, named random streams below it."""

from hashlib import blake2b

import numpy as np


def stream(seed: int, *use: str) -> np.random.Generator:
    """Return the generator for one use; equal on every machine and process.

    Args:
        seed: the run's one seed, >= 0.
        use: path of names, e.g. ("scenes", "kitchen_1").
    """
    word = blake2b("/".join(use).encode(), digest_size=8).digest()
    return np.random.default_rng([seed, int.from_bytes(word, "big")])
