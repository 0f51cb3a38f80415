"""People in a home: what they do really happens, is logged, and is the same again."""

import hashlib
import os
import subprocess
import sys

import pytest

from karma.errors import KarmaError
from karma.household.places import HAND
from karma.plugins.homes.habits import habits
from karma.plugins.homes.houses import build_home
from karma.plugins.homes.residents import ACTION_S, Household
from tests.support.lived import DAY_S, small_home

DIGEST = """
import hashlib
from karma.plugins.homes.houses import build_home
from karma.plugins.homes.residents import Household
household = Household(build_home(2, 4), seed=1, people=2, disturbance=0.4)
household.until(2 * 86_400.0)
print(hashlib.sha256(repr(household.log).encode()).hexdigest())
"""


def lived(disturbance=0.4, people=2, days=2, home=None):
    household = Household(home or small_home(), seed=1, people=people, disturbance=disturbance)
    household.until(days * DAY_S)
    return household


def test_equal_seeds_give_equal_logs_in_another_process_with_another_hash_seed():
    mine = hashlib.sha256(repr(lived().log).encode()).hexdigest()
    environment = {**os.environ, "PYTHONHASHSEED": "77"}
    other = subprocess.run(
        [sys.executable, "-c", DIGEST], capture_output=True, text=True, env=environment, check=True
    )
    assert other.stdout.strip() == mine


def test_the_log_is_the_world():
    household = lived(days=3)
    start = Household(small_home(), seed=1, people=0, disturbance=0.0).now()
    places = {one.object_id: one.place_id for one in start.values()}
    dirty = {one.object_id: "dirty" in one.states for one in start.values()}
    for deed in household.log:
        if deed.action == "PutObject":
            places[deed.object_id] = deed.place_id
        elif deed.action == "PickupObject":
            places[deed.object_id] = HAND
        elif deed.action in ("DirtyObject", "CleanObject"):
            dirty[deed.object_id] = deed.action == "DirtyObject"
    now = household.now()
    assert household.log
    assert {key: one.place_id for key, one in now.items()} == places
    assert {key: "dirty" in one.states for key, one in now.items()} == dirty


def test_times_go_on_and_nobody_acts_asleep_or_away():
    household = lived(days=5)
    times = [deed.time_s for deed in household.log]
    assert times == sorted(times)
    people = {one.name: one for one in household.residents}
    for deed in household.log:
        if deed.action == "PickupObject":
            begun = deed.time_s - 200.0  # deeds may wait a little for those before
            assert people[deed.who].is_up(deed.time_s) or people[deed.who].is_up(begun)


@pytest.mark.parametrize("wanted", [0.1, 0.3, 0.5])
def test_the_wanted_share_of_things_is_moved_on_a_day(wanted):
    shares = []
    for seed in range(4):
        home = build_home(3, 20 + seed)
        household = Household(home, seed=seed, people=3, disturbance=wanted)
        things = len(household.now())
        for day in range(5):
            deeds = household.until((day + 1) * DAY_S)
            moved = {deed.object_id for deed in deeds if deed.action == "PutObject"}
            shares.append(len(moved) / things)
    assert sum(shares) / len(shares) == pytest.approx(wanted, rel=0.25)


def test_nobody_or_no_disturbance_leaves_everything_as_it_is():
    for household in (lived(disturbance=0.0), lived(people=0)):
        assert household.log == []


def test_what_the_robot_holds_is_left_to_it():
    household = Household(small_home(), seed=1, people=2, disturbance=0.5)
    state = household.world.state
    mug = next(one for one in state.objects.values() if one.type in ("Mug", "Bowl", "Cup", "Plate"))
    assert household.robot("PickupObject", objectId=mug.id, forceAction=True)
    household.until(3 * DAY_S)
    assert household.world.state.held == mug.id
    assert household.now()[mug.id].place_id == HAND
    assert all(deed.object_id != mug.id for deed in household.log if deed.who != "robot")


def test_the_robots_deeds_are_logged_and_take_time():
    household = Household(small_home(), seed=1, people=0, disturbance=0.0)
    place = next(one for one in household.world.state.objects.values() if one.type == "CounterTop")
    thing = next(one for one in household.now().values() if one.object_type == "Apple")
    household.robot("PickupObject", objectId=thing.object_id, forceAction=True)
    household.robot("PutObject", objectId=place.id, forceAction=True)
    assert [(one.who, one.action, one.place_id) for one in household.log] == [
        ("robot", "PickupObject", thing.place_id),
        ("robot", "PutObject", place.id),
    ]
    assert household.clock_s == pytest.approx(2 * ACTION_S)


@pytest.mark.parametrize(("people", "disturbance"), [(5, 0.1), (-1, 0.1), (1, 0.6), (1, -0.1)])
def test_numbers_out_of_bounds_are_refused(people, disturbance):
    with pytest.raises(KarmaError, match="0 to 4"):
        Household(small_home(), seed=0, people=people, disturbance=disturbance)


def test_habits_name_only_what_there_is():
    table = habits()
    assert {"Mug", "Book", "KeyChain"} <= table.types.keys()
    assert "Sofa" not in table.types
