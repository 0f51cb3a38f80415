"""Settings of lived homes and of figures that there is nothing to do for are refused by key."""

import msgspec
import pytest

from karma.bench.policies.figure import TraceFigure
from karma.plugins.homes.lived.experiment import LivedExperiment

LIVED = {"name": "x", "benchmark": "lived", "rows": [{"name": "r", "design": "last-seen"}]}
FIGURE = {"kind": "trace", "name": "x", "policies": ["lru[2]"]}


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ([{"name": "s"}, {"name": "s", "units": 3}], "settings: 's' stands twice"),
        ([{"name": "s", "rooms": []}], r"length >= 1.*rooms"),
        ([{"name": "s", "rooms": [0]}], "rooms"),
        ([{"name": "s", "things": -3}], "things"),
        ([{"name": "s", "things": 0}], "things"),
        ([{"name": "s", "units": 0}], "units"),
        ([], "length >= 1.*settings"),
    ],
)
def test_settings_of_homes_that_make_no_home_are_refused_by_key(settings, said):
    with pytest.raises(msgspec.ValidationError, match=said):
        msgspec.convert({**LIVED, "settings": settings}, LivedExperiment)


@pytest.mark.parametrize("key", ["policies", "workloads", "unit_sets", "checkpoints"])
def test_figure_without_points_is_refused_by_key(key):
    with pytest.raises(msgspec.ValidationError, match=f"length >= 1.*{key}"):
        msgspec.convert({**FIGURE, key: []}, TraceFigure)
    with pytest.raises(msgspec.ValidationError, match=r">= 1.*checkpoints"):
        msgspec.convert({**FIGURE, "checkpoints": [0, 5]}, TraceFigure)


@pytest.mark.parametrize(("length", "points"), [(3, (3,)), (5, (5,)), (30, (5, 10, 25))])
def test_short_figure_is_looked_at_at_its_own_end(length, points):
    assert msgspec.convert({**FIGURE, "length": length}, TraceFigure).points == points
