"""Settings of lived homes that there is nothing to do for are refused by key."""

import msgspec
import pytest

from karma.plugins.homes.lived.experiment import LivedExperiment

LIVED = {"name": "x", "benchmark": "lived", "rows": [{"name": "r", "design": "last-seen"}]}


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
