"""What is remembered of looks is what a look shows: in a home where things go to and fro."""

from dataclasses import replace

import numpy as np
import pytest

from karma.contracts import Pose
from karma.plugins.homes.residents import Household
from karma.world.core.objects import Objects
from karma.world.core.view import sight
from tests.support.lived import HOUR_S, small_home


@pytest.mark.parametrize("seed", [4, 9])
def test_sight_is_the_same_as_without_a_memory(seed):
    household = Household(small_home(2, seed), seed=seed, people=2, disturbance=0.5)
    forks = [household, household.fork()]
    rng = np.random.default_rng(seed)
    cells = sorted(household.world.state.cells.values())
    poses = [
        Pose(position_m=(x, household.world.state.pose.position_m[1], z), yaw_deg=90.0 * turn,
             horizon_deg=30.0)
        for (x, z), turn in zip(rng.choice(cells, 12).tolist(), rng.integers(4, size=12).tolist(),
                                strict=True)
    ]  # fmt: skip
    different = set()
    for hour in range(7, 22):
        for home in forks:
            home.until(hour * HOUR_S)
            state = home.world.state
            for number, pose in enumerate(poses):
                seen = replace(state, pose=pose).sight
                fresh = sight(
                    Objects(dict(state.objects.items())), pose, held=state.in_hand,
                    visibility_m=state.settings.visibility_m, fov_deg=state.settings.fov_deg,
                    aspect=state.settings.aspect, shell=state.room.shell,
                )  # fmt: skip
                assert seen.visible == fresh.visible
                assert seen.interactable == fresh.interactable
                different.add((number, seen.visible))
    assert len(different) > len(poses)  # people changed what there is to see


def test_forks_of_a_home_live_on_alike_and_apart():
    home = Household(small_home(), seed=1, people=2, disturbance=0.5)
    home.until(9 * HOUR_S)
    logged, before = len(home.log), home.now()
    one, other = home.fork(), home.fork()
    assert one.until(20 * HOUR_S) == other.until(20 * HOUR_S) != ()
    assert one.now() == other.now()
    assert len(home.log) == logged
    assert home.now() == before
    assert list(home.until(20 * HOUR_S)) == one.log[logged:]
