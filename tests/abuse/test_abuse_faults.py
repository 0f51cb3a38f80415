"""Killed, without disk, memory or leave to write, or two at once: nothing is lost, nothing torn.

One instant or limit of each kind here, many in `scripts/check_abuse.py`. Runs of one worker under
kills and a full disk are in tests/bench/test_runs.py, a real bundle in tests/bundle.
"""

import random

import pytest
from support.abuse.faults import FAULTS

ELSEWHERE = ("run killed", "run, disk full", "installation, disk full")


@pytest.mark.parametrize("kind", [kind for kind in FAULTS if kind not in ELSEWHERE])
def test_fault_loses_nothing_tears_nothing_and_the_same_command_goes_on(kind, tmp_path):
    FAULTS[kind](tmp_path, random.Random(7))
