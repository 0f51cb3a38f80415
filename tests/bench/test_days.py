"""Where an episode begins: a seed changes something real, alike for all rows, asking nobody."""

from pathlib import Path

import pytest

from karma.agent.tour import explore_room
from karma.bench.engine.episode import Days, done_already, drawn
from karma.goals.files import load_tasks
from karma.goals.goals import parse_goal
from karma.types.tasks import SubTask, Task
from karma.world.sim import EmbeddedWorld

TASKS = {task.id: task for task in load_tasks(Path("eval/alfred_l/tasks.jsonl"))}


@pytest.fixture(scope="module")
def days():
    return Days()


def begun(days, task, seed):
    """Return what is where at the start of a task and seed, and how the agent stands."""
    world = EmbeddedWorld()
    days.of(world, task, seed).reset(task.scene.source)
    return dict(world.state.objects), world.state.pose


def test_seed_0_is_the_scene_as_it_is(days):
    task = TASKS["simple-01"]
    world = EmbeddedWorld()
    world.reset(task.scene.source)
    assert begun(days, task, 0) == (dict(world.state.objects), world.state.pose)
    assert days.of(world, task, 0) is world


def test_other_seeds_move_half_of_what_can_be_carried_and_nothing_else(days):
    task = TASKS["composite-03"]
    before, stood = begun(days, task, 0)
    after, stands = begun(days, task, 1)
    assert list(before) == list(after)
    assert stands != stood
    loose = [i for i, thing in before.items() if "pickupable" in thing.capabilities]
    moved = {i for i in before if before[i].center != after[i].center}
    assert moved <= set(loose)
    assert len(loose) // 4 <= len(moved) <= len(loose) // 2 + 4  # what stands in a bowl goes along


def test_starts_are_equal_for_equal_seeds_whatever_was_asked_before():
    task, other = TASKS["simple-02"], TASKS["complex-05"]
    one, two = Days(), Days()
    begun(two, other, 3)
    assert begun(one, task, 3) == begun(two, task, 3)
    assert begun(one, task, 3) == begun(one, task, 3)
    assert begun(one, task, 2) != begun(one, task, 3)


def test_a_reset_in_mid_episode_leads_back_to_the_start(days):
    task = TASKS["composite-01"]
    world = EmbeddedWorld()
    watched = days.of(world, task, 2)
    watched.reset(task.scene.source)
    first = dict(world.state.objects), world.state.pose
    graph, is_new = explore_room(watched, task.scene, None)
    assert is_new
    assert graph.objects()
    assert (dict(world.state.objects), world.state.pose) == first
    watched.reset("bedroom_1")
    plain = EmbeddedWorld()
    plain.reset("bedroom_1")
    assert dict(world.state.objects) == dict(plain.state.objects)


@pytest.mark.parametrize("name", ["kitchen_1", "living_2", "bathroom_3"])
def test_long_term_memory_of_a_room_does_not_depend_on_the_seed(days, name):
    """What is fixed is seen from every start, so that one map serves all of a run's episodes."""
    task = next(task for task in TASKS.values() if task.scene.name == name)
    world = EmbeddedWorld()
    maps = []
    for seed in (0, 1):
        here = days.of(world, task, seed)
        here.reset(task.scene.source)
        maps.append(explore_room(here, task.scene, None)[0])
    assert maps[0] == maps[1]


@pytest.mark.parametrize("kind", ["simple", "composite", "complex"])
def test_no_task_is_done_at_its_start_on_any_day(days, kind):
    for number, task in enumerate(task for task in TASKS.values() if task.kind == kind):
        event = days.of(EmbeddedWorld(), task, 1 + number % 4).reset(task.scene.source)
        assert not done_already(task, event), task.id


def test_first_draw_in_which_nothing_is_done_is_taken_and_told(days):
    world, draws = EmbeddedWorld(), {}
    for task in TASKS.values():
        draw = draws[task.id] = days.draw(world, task, 1)
        for passed_over in range(draw):
            assert done_already(task, drawn(world, task, 1, passed_over))
        assert not done_already(task, drawn(world, task, 1, draw))
    assert 0 in draws.values()
    assert any(draws.values())
    assert days.draw(world, task, 0) == 0


def test_what_is_done_in_the_scene_anyway_is_not_held_against_a_start():
    """A task that is done in every start still begins, by the first draw."""
    room = TASKS["simple-01"]
    done = SubTask(instruction="Close it.", goals=(parse_goal("CLOSED(Fridge)"),))
    task = Task(id="done", kind="simple", scene=room.scene, subtasks=(done,))
    world = EmbeddedWorld()
    assert done_already(task, world.reset(task.scene.source)) == {0}
    assert Days().draw(world, task, 1) == 0
