"""ALFRED's demonstrations as tasks of the policy laboratory."""

import gzip
import json

import pytest
from support.lab_trials import trial, write_trials

from karma.bench.policies.simulate import simulate
from karma.bench.policies.tasks import UNIT_SETS, Errand, draw_errands, trace_of
from karma.errors import FileError
from karma.plugins.alfred.task_pool import alfred_pool


@pytest.fixture(scope="module")
def real(request):
    shared = request.getfixturevalue("shared")
    return alfred_pool([shared / "data" / "alfred" / "train.jsonl.gz"])


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
