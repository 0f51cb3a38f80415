"""Failures that prompts tell of: in the agent's words, with a program that goes on from there."""

from collections import Counter

import pytest

from karma.agent.planning.inspector import mend, objection
from karma.agent.planning.program import parse_program
from karma.household.pieces import base_type
from karma.household.types import object_types
from karma.plugins.training.drawing.memories import room_of
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.past import live_memory, with_twins
from karma.plugins.training.samples import draw
from karma.seeds import stream
from karma.world.core import scene

BOOK = our_book()


@pytest.fixture(scope="module")
def rooms():
    return [room_of(scene.load(name), name) for name in ("kitchen_1", "living_1", "bedroom_1")]


@pytest.fixture(scope="module")
def failed(rooms):
    """Examples whose prompt tells of a failure, of 2,500."""
    every = (
        draw(stream(0, "failed", str(n)), rooms[n % 3], BOOK, mapped=True) for n in range(2500)
    )
    return [example for example in every if "#error " in example.changing]


def error_of(example):
    return next(ln[7:] for ln in example.changing.splitlines() if ln.startswith("#error "))


def held_of(example):
    lines = example.changing.splitlines()
    return next((ln[6:] for ln in lines if ln.startswith("#held ")), None)


def test_prompts_tell_of_a_failure_in_about_one_of_twelve(failed):
    assert 0.05 < len(failed) / 2500 < 0.11


def test_failures_are_of_all_sorts_that_the_agent_tells(failed):
    told = Counter(
        sign
        for example in failed
        for sign in ("is known", "remembered place", "is in the closed", "the hand holds",
                     "the hand is empty", "could not find", "gave up", "could not get", "cannot be")
        if sign in error_of(example)
    )  # fmt: skip
    assert len(told) == 9


def test_program_after_a_failure_parses_and_could_work(failed):
    for example in failed:
        calls = mend(
            parse_program(example.program), known=set(object_types()), held=held_of(example)
        )
        if example.kind in ("place", "clean_place", "stack", "pair", "heat_place", "cool_place"):
            continue  # where a thing goes is drawn without regard to what holds it
        assert objection(calls, held=held_of(example)) is None, (example.changing, example.program)


def test_what_could_not_be_found_is_not_looked_for_again(failed):
    lost = [example for example in failed if "could not find " in error_of(example)]
    assert len(lost) > 8
    for example in lost:
        name = error_of(example).split("could not find ")[1].split(";")[0]
        named = {one for call in parse_program(example.program) for one in call.objects}
        assert name not in {base_type(one.split("_")[0]) for one in named}


def test_what_a_thing_is_shut_in_is_opened_before_and_closed_after(failed):
    shut = [example for example in failed if "is in the closed " in error_of(example)]
    assert len(shut) > 3
    for example in shut:
        place = error_of(example).split("is in the closed ")[1].split(";")[0]
        lines = example.program.splitlines()
        at = lines.index(f"OpenObject(robot, '{place}')")
        assert lines[at + 1].startswith("PickupObject(")
        assert lines[at + 2] == f"CloseObject(robot, '{place}')"


def test_full_hand_is_freed_first(failed):
    full = [example for example in failed if "the hand holds " in error_of(example)]
    assert len(full) > 3
    for example in full:
        second = parse_program(example.program)[1]
        assert (second.skill, second.objects[0]) == ("PutObject", held_of(example))


def test_memory_with_twins_has_more_of_one_thing_and_no_more_than_it_holds(rooms):
    more = 0
    for number in range(60):
        rng = stream(0, "twins", str(number))
        units, _ = live_memory(rng, rooms[number % 3])
        found = with_twins(rng, rooms[number % 3], units)
        assert len(found) <= 10
        assert len({unit.object_id for unit in found}) == len(found)
        new = [unit for unit in found if unit not in units]
        assert {unit.object_type for unit in new} <= {unit.object_type for unit in units}
        more += bool(new)
    assert more > 30
