"""Killed, without disk, memory or leave to write, or two at once: nothing is lost, nothing torn.

One instant or limit of each kind, or as many as $KARMA_SAMPLE says. Without it runs of one worker
under kills and a full disk are left to tests/bench/test_runs.py, bundles to tests/plugins/airgap.
"""

import random

import pytest
from support.abuse import SAMPLE, SEED
from support.abuse.faults import FAULTS

ELSEWHERE = ("run killed", "run, disk full", "installation killed", "installation, disk full")


@pytest.mark.parametrize("kind", [kind for kind in FAULTS if SAMPLE or kind not in ELSEWHERE])
def test_fault_loses_nothing_tears_nothing_and_the_same_command_goes_on(kind, tmp_path):
    for number in range(SAMPLE or 1):
        place = tmp_path / str(number)
        place.mkdir()
        FAULTS[kind](place, random.Random(7 + SEED + number))
