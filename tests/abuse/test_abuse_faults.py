"""Killed, without disk, memory or leave to write, or two at once: nothing is lost, nothing torn.

One instant or limit of each kind, or as many as $KARMA_SAMPLE says. Runs of one worker under kills
and a full disk are in tests/bench/test_runs.py, maps in tests/test_kills.py.
"""

import random

import pytest
from support.abuse import SAMPLE, SEED
from support.abuse.faults import FAULTS


@pytest.mark.parametrize("kind", FAULTS)
def test_fault_loses_nothing_tears_nothing_and_the_same_command_goes_on(kind, tmp_path):
    for number in range(SAMPLE or 1):
        place = tmp_path / str(number)
        place.mkdir()
        FAULTS[kind](place, random.Random(7 + SEED + number))
