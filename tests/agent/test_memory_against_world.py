"""After random deeds in kitchens, what memory claims of handled things is held against the world.

`KARMA_SEQUENCES=400 pytest tests/agent/test_memory_against_world.py` does 2,000 of them.
"""

import os
from dataclasses import replace

import pytest
from support.household import kitchen
from support.paths import ROOT
from support.random_deeds import sequence, untrue

from karma.contracts import MemoryUnit
from karma.files import to_json
from karma.world.sim import EmbeddedWorld

SEQUENCES = int(os.environ.get("KARMA_SEQUENCES", "3"))  # in each room
DEEDS = 6
ROOMS = ("handmade", "kitchen_1", "kitchen_2", "kitchen_3", "kitchen_4")


@pytest.mark.parametrize("room", ROOMS)
def test_memory_claims_nothing_of_what_it_handled_that_is_not_so(room, tmp_path):
    path = ROOT / f"karma/world/scenes/{room}.json"
    if room == "handmade":
        path = tmp_path / "handmade.json"
        path.write_bytes(to_json(kitchen()))
    found, handled = {}, 0
    for seed in range(SEQUENCES):
        for number, (claims, program) in enumerate(sequence(path, tmp_path, seed, DEEDS)):
            handled += "PickupObject" in program
            if claims:
                found[seed, number] = (program, claims)
    assert not found
    assert handled > SEQUENCES


APPLE = "Apple|+01.40|+00.85|-00.50"


@pytest.mark.parametrize(
    ("change", "claim"),
    [
        ({"place_id": "Bowl|+01.70|+00.84|-00.50"}, "it lies in or on"),
        ({"place_id": "hand"}, "in the hand"),
        ({"position_m": (0.0, 0.9, 1.2)}, "it is at"),
        ({"states": ("sliced",)}, "not sliced"),
        ({"object_id": "Apple|+09.00|+00.85|-00.50"}, "there is no such thing"),
        ({}, ""),
    ],
)
def test_claim_that_is_not_so_is_found(change, claim, tmp_path):
    path = tmp_path / "handmade.json"
    path.write_bytes(to_json(kitchen()))
    world = EmbeddedWorld(str(path))
    world.reset(str(path))
    x, y, z = world.last_event.get_object(APPLE)["position"].values()
    unit = MemoryUnit(object_id=APPLE, object_type="Apple", position_m=(x, y, z), handled=True)
    found = untrue([replace(unit, **change)], world)
    assert len(found) == bool(claim)
    assert all(claim in one for one in found)
