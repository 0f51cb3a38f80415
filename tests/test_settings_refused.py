"""Settings of figures that there is nothing to do for are refused by key."""

import msgspec
import pytest

from karma.bench.policies.figure import TraceFigure

FIGURE = {"kind": "trace", "name": "x", "policies": ["lru[2]"]}


@pytest.mark.parametrize("key", ["policies", "workloads", "unit_sets", "checkpoints"])
def test_figure_without_points_is_refused_by_key(key):
    with pytest.raises(msgspec.ValidationError, match=f"length >= 1.*{key}"):
        msgspec.convert({**FIGURE, key: []}, TraceFigure)
    with pytest.raises(msgspec.ValidationError, match=r">= 1.*checkpoints"):
        msgspec.convert({**FIGURE, "checkpoints": [0, 5]}, TraceFigure)


@pytest.mark.parametrize(("length", "points"), [(3, (3,)), (5, (5,)), (30, (5, 10, 25))])
def test_short_figure_is_looked_at_at_its_own_end(length, points):
    assert msgspec.convert({**FIGURE, "length": length}, TraceFigure).points == points
