"""Embedders of texts and pictures, and what they share: rows of length 1."""

from collections.abc import Iterable

import numpy as np

from karma.types.space import Vectors

REMEMBERED = 20_000  # rows that an embedder keeps, 30 MB of 384 numbers each


def stacked(rows: Iterable[Vectors], dimension: int) -> Vectors:
    """Return rows as one array, shape (n, dimension); n may be 0."""
    return np.array([*rows], np.float32).reshape(-1, dimension)


def unit_row(values: object) -> Vectors:
    """Return a row at length 1; ValueError for what is no row of numbers, or of no length."""
    row = np.asarray(values, np.float32)
    if row.ndim != 1:
        raise ValueError(f"an array of shape {row.shape} is not one row")
    length = float(np.linalg.norm(row))
    if not np.isfinite(length) or length == 0:
        raise ValueError(f"a row of length {length}")
    unit: Vectors = row / np.float32(length)
    return unit
