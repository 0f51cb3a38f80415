"""The laboratory's tasks and workloads.

Covered: units of tasks in ALFRED's form, the rules of each workload, agreement with the figures
that others measured on ALFRED.
"""

import gzip
import json
import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from itertools import groupby

import pytest
from support.lab_trials import many_trials, trial, write_trials

from karma.bench.policies.simulate import simulate
from karma.bench.policies.tasks import (
    DAY,
    DAYS,
    STAY,
    UNIT_SETS,
    WORKLOADS,
    Errand,
    Finds,
    Pool,
    costs_of,
    draw_errands,
    grammar_pool,
    trace_of,
)
from karma.errors import FileError, KarmaError
from karma.household.places import ROOMS
from karma.plugins.alfred.task_pool import alfred_pool
from karma.seeds import stream


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    return alfred_pool([write_trials(tmp_path_factory.mktemp("t") / "t.jsonl.gz", many_trials())])


@pytest.fixture(scope="module")
def real(request):
    shared = request.getfixturevalue("shared")
    return alfred_pool([shared / "data" / "alfred" / "train.jsonl.gz"])


# ----------------------------------------------------------------- tasks


def test_units_of_tasks_in_alfreds_form(tmp_path):
    path = write_trials(
        tmp_path / "t.jsonl.gz",
        [
            trial(5, "Apple", "Fridge", movable="Bowl", sliced=True,
                  picked=[("ButterKnife", "Drawer"), ("Apple", "Sink"), ("ButterKnife", "Sink")]),
            trial(301, "CD", "", toggle="DeskLamp", picked=[("CD", "Desk")]),
            trial(405, "BreadSliced", "Bread", picked=[("Knife", "Desk")]),
        ],
    )  # fmt: skip
    first, second, third = alfred_pool([path]).errands
    assert first == Errand(
        scene="FloorPlan5", room="kitchen", r4=("Apple", "Bowl", "Fridge"),
        m=("Apple", "Bowl", "ButterKnife"), subjects=("Apple", "Bowl"),
    )  # fmt: skip
    assert (second.room, second.r4, second.m) == ("bedroom", ("CD", "DeskLamp"), ("CD",))
    assert (third.r4, third.m) == (("Bread",), ("Bread",))


@pytest.mark.parametrize(
    "data, says",
    [
        (b"", "no demonstrations"),
        (gzip.compress(b'{"pddl_params": {}}\n'), "line 1"),
        (gzip.compress(json.dumps(trial(1, "Mug", "Sink")).encode() + b"\n{"), "line 2"),
        (gzip.compress(json.dumps(trial("X", "Mug", "Sink")).encode()), "no floor plan"),
        (gzip.compress(b"{}" * 99)[:-5], "not ALFRED"),
        (b"{}", "not ALFRED"),
    ],
    ids=["empty", "no fields", "second line", "no plan", "torn", "plain text"],  # gzip has a clock
)
def test_files_that_are_not_alfreds_are_refused(tmp_path, data, says):
    path = tmp_path / "t.jsonl.gz"
    path.write_bytes(data)
    with pytest.raises(FileError, match=says) as caught:
        alfred_pool([path])
    assert str(path) in str(caught.value)


def test_search_visits_the_likeliest_receptacles_first():
    places = {"A": {"Shelf": 2, "Drawer": 3}}
    finds = Finds(places=places, found={("kitchen", "Mug"): {"Shelf": 7, "Drawer": 1}})
    shelf, drawer = 7.5 / 9, 1.5 / 9  # half a find is added to each
    assert finds.stops("A", "kitchen", "Mug") == pytest.approx(shelf * 1.5 + drawer * (2 + 2))
    assert finds.stops("A", "kitchen", "Pan") == pytest.approx(0.5 * 2 + 0.5 * (3 + 1.5))
    assert finds.stops("B", "kitchen", "Mug") is None


def test_only_what_can_be_carried_is_searched_for(pool):
    errand = pool.errands[0]
    assert pool.cost(errand, "Fridge") == 1
    assert pool.cost(errand, errand.m[0]) > 1
    units = [unit for one in pool.errands[:9] for unit in one.units("r4")]
    assert len(costs_of(pool.errands[:9], "r4", pool)) == len(units)


def test_requests_of_our_grammar_are_tasks_of_every_room():
    pool = grammar_pool(3, scenes=2, tasks=12)
    assert {errand.room for errand in pool.errands} == set(ROOMS)
    assert all(errand.m and set(errand.subjects) <= set(errand.r4) for errand in pool.errands)
    assert any(set(errand.r4) - set(errand.m) for errand in pool.errands)
    costs = [pool.cost(errand, unit) for errand in pool.errands for unit in errand.m]
    assert min(costs) >= 1
    assert max(costs) > 2
    anew = grammar_pool.__wrapped__  # past what is kept
    assert anew(3, scenes=2, tasks=12) == pool != anew(4, scenes=2, tasks=12)


# ----------------------------------------------------------------- workloads


@pytest.mark.parametrize("workload", WORKLOADS)
def test_shorter_sequence_is_the_beginning_of_a_longer_one(pool, workload):
    long = draw_errands(pool, workload, 400, 5, 2)
    assert draw_errands(pool, workload, 30, 5, 2) == long[:30]
    assert draw_errands(pool, workload, 400, 5, 3) != long
    assert draw_errands(pool, workload, 400, 6, 2) != long


@pytest.mark.parametrize("workload", [one for one in WORKLOADS if one != "type"])
def test_house_has_one_room_of_each_kind(pool, workload):
    drawn = draw_errands(pool, workload, 600, 5, 0)
    assert len({errand.scene for errand in drawn}) == 4
    assert {errand.room for errand in drawn} == set(ROOMS)


def test_type_draws_evenly_from_all_tasks(pool):
    drawn = Counter(map(id, draw_errands(pool, "type", 30_000, 5, 0)))
    mean = 30_000 / len(pool.errands)
    chi2 = sum((drawn[id(errand)] - mean) ** 2 / mean for errand in pool.errands)
    freedom = len(pool.errands) - 1
    assert abs(chi2 - freedom) < 4 * (2 * freedom) ** 0.5


def test_rooms_are_left_after_eight_tasks_on_average(pool):
    drawn = draw_errands(pool, "rooms", 20_000, 5, 0)
    stays = [len(list(group)) for _, group in groupby(drawn, key=lambda errand: errand.room)]
    mean = sum(stays) / len(stays)
    assert abs(mean - STAY) < 4 * (STAY * (STAY - 1) / len(stays)) ** 0.5


def test_habits_keep_their_hours_and_follow_zipf(pool):
    tops, draws, expected, variance = 0, 0, 0.0, 0.0
    for number in range(30):
        drawn = draw_errands(pool, "habit", DAYS * DAY, 5, number)
        rooms = [errand.room for errand in drawn]
        assert all(rooms[at] == rooms[at % DAY] for at in range(len(rooms)))
        for room in ROOMS:
            mine = [errand for errand in drawn if errand.room == room]
            first = 1 / sum(1 / rank for rank in range(1, len(pool.homes[room][mine[0].scene]) + 1))
            half = len(mine) // 2  # the favourite of one half is counted in the other
            favourite = Counter(map(id, mine[:half])).most_common(1)[0][0]
            tops += sum(id(errand) == favourite for errand in mine[half:])
            draws += len(mine) - half
            expected += first * (len(mine) - half)
            variance += first * (1 - first) * (len(mine) - half)
    assert tops <= expected + 4 * variance**0.5
    assert tops >= 0.8 * expected  # now and then the second task is taken for the first


def test_a_fifth_of_the_habits_is_dealt_anew_after_twenty_days(pool):
    dropped = often = 0
    for number in range(15):
        drawn = draw_errands(pool, "habit", 2 * DAYS * DAY, 5, number)
        before, after = (Counter(map(id, drawn[at:][: DAYS * DAY])) for at in (0, DAYS * DAY))
        favourites = [task for task, count in before.items() if count >= 8]
        often += len(favourites)
        dropped += sum(after[task] <= 1 for task in favourites)
    assert 0.05 < dropped / often < 0.3  # without a change about 0.003 would come that seldom


def test_half_of_a_chain_is_about_what_came_before(real_like_chain):
    drawn, every = real_like_chain
    keys = [{(errand.scene, name) for name in errand.subjects} for errand in drawn]
    linked = sum(
        bool(mine & set().union(*keys[max(0, at - 3) : at])) for at, mine in enumerate(keys) if at
    ) / (len(keys) - 1)
    rng = stream(2, "lab-tests", "chance")
    shuffled = [keys[int(i)] for i in rng.permutation(len(keys))]
    chance = sum(
        bool(mine & set().union(*shuffled[max(0, at - 3) : at]))
        for at, mine in enumerate(shuffled)
        if at
    ) / (len(keys) - 1)
    assert abs(linked - (0.5 + 0.5 * chance)) < 0.05
    assert every > 100


@pytest.fixture
def real_like_chain():
    """A chain in a house of so many things that hardly any two tasks share one by chance."""
    errands = tuple(
        Errand(scene=room, room=room, r4=(f"T{n}",), m=(f"T{n}",), subjects=(f"T{n}",))
        for room in ROOMS
        for n in range(60)
    )
    pool = Pool(source="made up", errands=errands, finds=Finds(places={}, found={}))
    return draw_errands(pool, "chain", 4000, 5, 0), len(errands)


def test_unit_is_a_type_or_a_type_in_its_room(pool):
    drawn = draw_errands(pool, "type", 50, 5, 0)
    assert set(trace_of(drawn, "type", "r4").keys) == {u for e in drawn for u in e.r4}
    keys = trace_of(drawn, "house", "m").keys
    assert set(keys) == {f"{e.scene}/{u}" for e in drawn for u in e.m}


def test_pool_without_a_kind_of_room_makes_no_house(pool):
    few = replace(pool, errands=tuple(e for e in pool.errands if e.room != "bedroom"))
    with pytest.raises(KarmaError, match="bedroom"):
        draw_errands(few, "house", 5, 0, 0)


def test_sequences_do_not_depend_on_the_hash_seed(tmp_path):
    write_trials(tmp_path / "t.jsonl.gz", many_trials(60))
    code = (
        "import sys; from pathlib import Path; from karma.bench.policies.tasks import *\n"
        "from karma.plugins.alfred.task_pool import alfred_pool\n"
        "pool = alfred_pool([Path(sys.argv[1])])\n"
        "for work in WORKLOADS:\n"
        "    drawn = draw_errands(pool, work, 60, 1, 0)\n"
        "    print(trace_of(drawn, work, 'r4').named(), costs_of(drawn, 'm', pool))\n"
        "print(grammar_pool(1, scenes=1, tasks=4).errands)\n"
    )
    printed = {
        subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "t.jsonl.gz")],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in ("0", "7")
    }  # fmt: skip
    assert len(printed) == 1


# ----------------------------------------------------------------- what others measured


@pytest.mark.shared
def test_real_tasks_have_the_known_units(real):
    assert len(real.errands) == 6574
    kinds = {units: {u for e in real.errands for u in e.units(units)} for units in UNIT_SETS}
    assert {units: len(found) for units, found in kinds.items()} == {"r4": 79, "m": 53}
    for units, mean in (("r4", 2.149), ("m", 1.287)):
        asked = sum(len(errand.units(units)) for errand in real.errands)
        assert asked / len(real.errands) == pytest.approx(mean, abs=0.003)


@pytest.mark.shared
@pytest.mark.parametrize(
    "workload, units, policy, rate",
    [
        ("type", "r4", "wtinylfu-karma[9,1] W=20", 19.8),
        ("type", "r4", "wtinylfu-karma[9,1]", 25.0),
        ("type", "r4", "wtinylfu-karma[9,1] W=500", 29.1),
        ("type", "r4", "wtinylfu-karma[9,1] W=inf", 30.1),
        ("rooms", "m", "wtinylfu-karma[9,1] W=20", 55.9),
        ("rooms", "m", "wtinylfu-karma[9,1]", 50.8),
    ],
)
def test_hit_rates_are_those_that_were_measured_before(real, workload, units, policy, rate):
    """By others, on sequences of their own from 506 more tasks; rooms vary most from each other."""
    drawn = [draw_errands(real, workload, 1000, 0, number) for number in range(12)]
    rates = [100 * simulate(policy, trace_of(one, workload, units)).rate() for one in drawn]
    mean = sum(rates) / len(rates)
    error = (sum((one - mean) ** 2 for one in rates) / (len(rates) - 1) / len(rates)) ** 0.5
    assert abs(mean - rate) < 4 * error + 0.3
