"""What is asked is found however much came later; a restart answers the same, in its own home."""

import random
from dataclasses import replace

import numpy as np
import pytest

from karma.bench.suites.lived.designs import DESIGNS
from karma.contracts import Deed, HomeMoment, HomeQuestion, Meaning, SaidThing, Sighting
from karma.errors import FileError
from karma.memory.lived.setting import KnownPlace, MemorySetting

HOUR = 3600.0


class Letters:
    """An embedder to which all texts are alike."""

    name, dimension = "letters", 8

    def embed(self, texts):
        return np.ones((len(texts), 8), np.float32) / 8**0.5


def places(*kinds):
    return {
        f"{kind}|{number}": KnownPlace(
            place_id=f"{kind}|{number}", place_type=kind, room="kitchen_1", room_kind="kitchen",
            openable=False,
        )
        for number, kind in enumerate(kinds)
    }  # fmt: skip


PLACES = places("CounterTop", "DiningTable", "Desk", "Sofa")
IDS = tuple(PLACES)


def made(design="ours", **given):
    return DESIGNS[design](MemorySetting(**{"embedder": Letters(), "places": PLACES, **given}))


def see(time_s, name, place, states=()):
    return Sighting(
        time_s=time_s, object_id=name, object_type=name.partition("|")[0], place_id=place,
        room="kitchen_1", position_m=(0.0, 0.0, 0.0), states=states,
    )  # fmt: skip


def moment(time_s, *seen, deed=None):
    return HomeMoment(time_s=time_s, room="kitchen_1", seen=seen, deed=deed)


def ask(time_s, kind, asked="place", **said):
    thing = SaidThing(phrase=kind, types=(Meaning(name=kind, similarity=1.0),), **said)
    return HomeQuestion(text=kind, speaker="Ann", time_s=time_s, asked=asked, thing=thing)


@pytest.mark.parametrize("later", [0, 255, 256, 900])
def test_who_did_it_is_known_however_often_it_was_seen_later(later):
    memory, time_s = made(), 30_000.0
    deed = Deed(time_s=time_s, who="Ann", action="PutObject", object_id="Book|0",
                object_type="Book", place_id=IDS[1])  # fmt: skip
    memory.take_in(moment(time_s, see(time_s, "Book|0", IDS[1]), deed=deed))
    for number in range(later):
        time_s += HOUR
        seen = see(time_s, f"Book|{1 + number % 4}", IDS[(number // 4) % 4])
        memory.take_in(moment(time_s, seen))
    found = memory.recall(ask(time_s + 60, "Book", "who"), 64)
    assert [fact.deed.who for fact in found] == ["Ann"]


@pytest.mark.parametrize("clean", [3, 100, 400])
@pytest.mark.parametrize("state", ["dirty", "filled"])
def test_state_that_is_asked_for_is_found_among_many_without_it(clean, state):
    memory = made()
    memory.take_in(moment(6 * HOUR, see(6 * HOUR, "Mug|d", IDS[2], (state,))))
    for number in range(clean):
        time_s = 7 * HOUR + 10 * number
        memory.take_in(moment(time_s, see(time_s, f"Mug|{number}", IDS[number % 4])))
    question = ask(60 * HOUR, "Mug", states=(state,), after_s=5 * HOUR, before_s=12 * HOUR)
    found = memory.recall(question, 8)
    assert [fact.sighting.object_id for fact in found] == ["Mug|d"]
    other = replace(question, thing=replace(question.thing, states=("opened",)))
    assert len(memory.recall(other, 8)) == min(8, clean + 1)  # never seen so: what there is


@pytest.mark.parametrize("seed", range(20))
def test_restart_answers_in_the_same_order(seed, tmp_path):
    draw = random.Random(seed)
    memory, time_s = made(folder=tmp_path), 0.0
    for _ in range(12):
        time_s += draw.choice((600.0, HOUR))
        names = draw.sample([f"Mug|{letter}" for letter in "abcdef"], draw.randint(1, 4))
        memory.take_in(moment(time_s, *(see(time_s, one, draw.choice(IDS)) for one in names)))

    def told():
        return [fact.sighting for fact in memory.recall(ask(time_s + 60, "Mug"), 6)]

    before = told()
    memory.close()
    memory = made(folder=tmp_path)
    assert told() == before


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_sighting_without_a_position_is_none_and_what_was_known_stays(bad, tmp_path):
    memory = made(folder=tmp_path)
    memory.take_in(moment(HOUR, see(HOUR, "Mug|a", IDS[0])))
    torn = replace(see(2 * HOUR, "Mug|a", IDS[1]), position_m=(0.0, bad, 0.0))
    memory.take_in(moment(2 * HOUR, torn))
    memory.close()
    (fact,) = made(folder=tmp_path).recall(ask(3 * HOUR, "Mug"), 3)
    assert fact.sighting.place_id == IDS[0]


def test_log_of_another_home_is_refused_by_name(tmp_path):
    memory = made(folder=tmp_path)
    memory.take_in(moment(HOUR, see(HOUR, "Mug|a", IDS[0])))
    memory.close()
    with pytest.raises(FileError, match=r"the log of another home") as error:
        made(folder=tmp_path, places=places("Bed", "Desk"))
    assert str(tmp_path) in str(error.value)
    assert made(folder=tmp_path).recall(ask(2 * HOUR, "Mug"), 1)


@pytest.mark.parametrize("units", [1, 3, 10])
def test_no_more_than_its_units_after_any_restart(units, tmp_path):
    for run in range(4):
        memory = made(TEN, folder=tmp_path, units=units)
        for number in range(5):
            time_s = HOUR * (1 + 10 * run + number)
            memory.take_in(moment(time_s, see(time_s, f"Mug|{run}{number}", IDS[number % 4])))
            assert len(memory.recall(ask(time_s + 60, "Mug"), 99)) <= units
        memory.close()
    smaller = made(TEN, folder=tmp_path, units=1)
    assert len(smaller.recall(ask(100 * HOUR, "Mug"), 99)) <= 1


TEN = next(name for name, one in DESIGNS.items() if one.__name__ == "TrueUnits")
