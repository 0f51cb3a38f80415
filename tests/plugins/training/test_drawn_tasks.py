"""Drawn memories and drawn tasks: what they may hold, and that equal seeds give equal ones."""

from collections import Counter
from pathlib import Path

import pytest

from karma.goals.files import load_tasks
from karma.goals.goals import parse_goal
from karma.household.pieces import base_type
from karma.household.types import object_types
from karma.plugins.training.drawing.drawn_tasks import draw_task
from karma.plugins.training.drawing.memories import room_of
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.drawing.requests import PAIR, WITH_PAIRS
from karma.plugins.training.past import live_memory
from karma.plugins.training.task_files import draw_tasks, fresh_rooms
from karma.seeds import stream
from karma.world.core import scene

BOOK = our_book().part(held_out=True)


@pytest.fixture(scope="module")
def rooms():
    return [room_of(scene.load(name), name) for name in ("kitchen_1", "living_1", "bedroom_1")]


def stories(rooms, kind, count, *, seed=0):
    for number in range(count):
        story = draw_task(stream(seed, kind, str(number)), rooms[number % 3], BOOK, kind)
        if story is not None:
            yield story


# ----------------------------------------------------------------- memories


def histories(rooms, count):
    return [live_memory(stream(0, "history", str(n)), rooms[n % 3]) for n in range(count)]


def test_histories_hold_at_most_ten_units_of_things_that_can_be_carried(rooms):
    for units, held in histories(rooms, 200):
        assert len(units) <= 10
        assert len({unit.object_id for unit in units}) == len(units)
        for unit in units:
            assert "pickupable" in object_types()[unit.object_type].capabilities
        assert [unit for unit in units if unit.place_id == "hand"] == ([held] if held else [])


def test_histories_never_hold_opposite_states(rooms):
    opposites = ({"on", "off"}, {"opened", "closed"}, {"cleaned", "dirty"})
    for units, _ in histories(rooms, 200):
        for unit in units:
            assert not any(pair <= set(unit.states) for pair in opposites)
            assert len(set(unit.states)) == len(unit.states)


def test_histories_leave_the_marks_of_requests(rooms):
    states = Counter(s for units, _ in histories(rooms, 300) for u in units for s in u.states)
    assert {"cleaned", "sliced", "heated", "filled", "on", "off", "opened", "closed"} <= set(states)


# ----------------------------------------------------------------- tasks


@pytest.mark.parametrize(
    ("kind", "least", "most"), [("simple", 1, 1), ("composite", 2, 4), ("complex", 3, 5)]
)
def test_stories_have_as_many_requests_as_their_kind(rooms, kind, least, most):
    found = [len(story) for story in stories(rooms, kind, 60)]
    assert len(found) > 40
    assert min(found) == least
    assert max(found) == most


def test_stories_have_goals_that_parse_and_name_what_the_room_has(rooms):
    for number, story in enumerate(stories(rooms, "complex", 60)):
        assert number < 60
        for step in story:
            assert step.goals
            for goal in step.goals:
                assert parse_goal(str(goal)).predicate == goal.predicate


def test_stories_with_pairs_ask_for_two_of_what_the_room_has_two_of(rooms):
    asked = set()
    for number in range(300):
        room = rooms[number % 3]
        story = draw_task(stream(7, "pairs", str(number)), room, BOOK, "simple", WITH_PAIRS)
        for step in story or ():
            goals = [goal for goal in step.goals if goal.count > 1]
            assert bool(goals) is (step.kind == PAIR)
            for goal in goals:
                assert goal == parse_goal(str(goal))
                assert (goal.predicate, goal.count) == ("ON", 2)
                assert goal.arguments[0] in room.several
                asked.add(step.text)
    assert len(asked) > 5


def test_stories_ask_for_pairs_only_where_they_are_wanted(rooms):
    kinds = {step.kind for story in stories(rooms, "complex", 60) for step in story}
    assert PAIR not in kinds


def test_requests_of_a_composite_task_are_about_what_was_handled(rooms):
    for story in stories(rooms, "composite", 60):
        known = set()
        for step in story:
            names = {base_type(word) for goal in step.goals for word in goal.arguments}
            if known:
                knives = {"Knife"} if any("sliced" in g.arguments for g in step.goals) else set()
                assert names & (known | knives)
            known |= names | {"Knife"}


def test_later_requests_of_a_complex_task_do_not_name_their_thing(rooms):
    """They speak of kinds, states, places and deeds: the first ones name everything."""
    named = total = 0
    for story in stories(rooms, "complex", 90):
        goal = story[-1].goals[0]
        thing = goal.arguments[1] if goal.predicate == "HOLDON" else goal.arguments[0]
        total += 1
        named += thing.lower() in story[-1].text.replace(" ", "")
    assert total > 60
    assert named / total < 0.3


def test_tasks_are_written_as_an_experiment_reads_them_and_twice_the_same(tmp_path):
    for name in ("one", "other"):
        homes = list(fresh_rooms(2, 3))
        drawn = draw_tasks(tmp_path / name, BOOK, scenes=homes, each=1, seed=3, filtered=True)
        assert (drawn.tasks, drawn.rooms) == (3, 2)
        assert drawn.tried == 3 + sum(drawn.left_out.values())
    tasks = load_tasks(tmp_path / "one" / "tasks.jsonl")
    assert [task.kind for task in tasks] == ["simple", "composite", "complex"]
    assert all(Path(task.scene.path).exists() for task in tasks)
    said = [
        [sub for task in load_tasks(tmp_path / name / "tasks.jsonl") for sub in task.subtasks]
        for name in ("one", "other")
    ]
    assert said[0] == said[1]
