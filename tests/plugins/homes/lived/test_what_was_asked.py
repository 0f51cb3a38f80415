"""What is asked is found however much came later."""

from dataclasses import replace

import pytest

from karma.plugins.homes.memory.true_memory import TrueMemory, TrueUnits
from karma.plugins.homes.types import Deed
from tests.support.lived import HOUR_S as HOUR
from tests.support.lived import PLACES, moment, seen, setting, where

IDS = tuple(PLACES)[:4]


def made():
    return TrueMemory(setting())


@pytest.mark.parametrize("later", [0, 255, 256, 900])
def test_who_did_it_is_known_however_often_it_was_seen_later(later):
    memory, time_s = made(), 30_000.0
    deed = Deed(time_s=time_s, who="Ann", action="PutObject", object_id="Book|0",
                object_type="Book", place_id=IDS[1])  # fmt: skip
    memory.take_in(moment(time_s, seen("Book|0", IDS[1], time_s), deed=deed))
    for number in range(later):
        time_s += HOUR
        other = seen(f"Book|{1 + number % 4}", IDS[(number // 4) % 4], time_s)
        memory.take_in(moment(time_s, other))
    found = memory.recall(where("Book", time_s + 60, "who"), 64)
    assert [fact.deed.who for fact in found] == ["Ann"]


@pytest.mark.parametrize("clean", [3, 100, 400])
@pytest.mark.parametrize("state", ["dirty", "filled"])
def test_state_that_is_asked_for_is_found_among_many_without_it(clean, state):
    memory = made()
    memory.take_in(moment(6 * HOUR, seen("Mug|d", IDS[2], 6 * HOUR, (state,))))
    for number in range(clean):
        time_s = 7 * HOUR + 10 * number
        memory.take_in(moment(time_s, seen(f"Mug|{number}", IDS[number % 4], time_s)))
    question = where("Mug", 60 * HOUR, states=(state,), after_s=5 * HOUR, before_s=12 * HOUR)
    found = memory.recall(question, 8)
    assert [fact.sighting.object_id for fact in found] == ["Mug|d"]
    other = replace(question, thing=replace(question.thing, states=("opened",)))
    assert len(memory.recall(other, 8)) == min(8, clean + 1)  # never seen so: what there is


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_sighting_without_a_position_is_none_and_what_was_known_stays(bad):
    memory = made()
    memory.take_in(moment(HOUR, seen("Mug|a", IDS[0], HOUR)))
    torn = replace(seen("Mug|a", IDS[1], 2 * HOUR), position_m=(0.0, bad, 0.0))
    memory.take_in(moment(2 * HOUR, torn))
    (fact,) = memory.recall(where("Mug", 3 * HOUR), 3)
    assert fact.sighting.place_id == IDS[0]


@pytest.mark.parametrize("units", [1, 3, 10])
def test_ten_units_hold_no_more_than_their_number(units):
    memory = TrueUnits(setting(units=units))
    for number in range(20):
        time_s = HOUR * (1 + number)
        memory.take_in(moment(time_s, seen(f"Mug|{number}", IDS[number % 4], time_s)))
        assert len(memory.recall(where("Mug", time_s + 60), 99)) <= units
