"""The laboratory's tasks and workloads.

Covered: the tasks of our grammar, and the rules of each workload.
"""

import hashlib
import os
import subprocess
import sys

import pytest

from karma.bench.policies.tasks import (
    WORKLOADS,
    Errand,
    Finds,
    Pool,
    draw_errands,
    grammar_pool,
)
from karma.household.places import ROOMS
from karma.seeds import stream


@pytest.fixture(scope="module")
def pool():
    return grammar_pool(7, scenes=3, tasks=25)


@pytest.fixture(scope="module")
def made_up():
    """Tasks in a house of so many things that hardly any two share one by chance."""
    errands = tuple(
        Errand(scene=room, room=room, r4=(f"{room}{n}",), m=(f"{room}{n}",), subjects=(f"T{n}",))
        for room in ROOMS
        for n in range(60)
    )
    return Pool(source="made up", errands=errands, finds=Finds(places={}, found={}))


# ----------------------------------------------------------------- tasks


def test_search_visits_the_likeliest_receptacles_first():
    places = {"A": {"Shelf": 2, "Drawer": 3}}
    finds = Finds(places=places, found={("kitchen", "Mug"): {"Shelf": 7, "Drawer": 1}})
    shelf, drawer = 7.5 / 9, 1.5 / 9  # half a find is added to each
    assert finds.stops("A", "kitchen", "Mug") == pytest.approx(shelf * 1.5 + drawer * (2 + 2))
    assert finds.stops("A", "kitchen", "Pan") == pytest.approx(0.5 * 2 + 0.5 * (3 + 1.5))
    assert finds.stops("B", "kitchen", "Mug") is None


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


DIGESTS = {
    "type": "b3cf09326b00",
    "house": "1f48d282cef4",
    "rooms": "6e3d5cd21c52",
    "habit": "d3e39a55385f",
    "chain": "20f2486056fd",
}


@pytest.mark.parametrize("workload", DIGESTS)
def test_workload_is_the_one_of_the_figures(made_up, workload):
    """Digests of sequences, by which a changed rule or order of draws shows."""
    drawn = draw_errands(made_up, workload, 600, 5, 0)
    text = " ".join(errand.r4[0] for errand in drawn)
    assert hashlib.sha256(text.encode()).hexdigest()[:12] == DIGESTS[workload]


@pytest.mark.parametrize("workload", [one for one in WORKLOADS if one != "type"])
def test_house_has_one_room_of_each_kind(pool, workload):
    drawn = draw_errands(pool, workload, 600, 5, 0)
    assert len({errand.scene for errand in drawn}) == 4
    assert {errand.room for errand in drawn} == set(ROOMS)


def test_half_of_a_chain_is_about_what_came_before(made_up):
    drawn = draw_errands(made_up, "chain", 4000, 5, 0)
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


def test_sequences_do_not_depend_on_the_hash_seed():
    code = (
        "from karma.bench.policies.tasks import *\n"
        "pool = grammar_pool(1, scenes=1, tasks=9)\n"
        "for work in WORKLOADS:\n"
        "    drawn = draw_errands(pool, work, 60, 1, 0)\n"
        "    print(trace_of(drawn, work, 'r4').tasks, costs_of(drawn, 'm', pool))\n"
        "print(grammar_pool(1, scenes=1, tasks=4).errands)\n"
    )
    printed = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in ("0", "7")
    }  # fmt: skip
    assert len(printed) == 1
