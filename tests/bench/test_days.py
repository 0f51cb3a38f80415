"""Where an episode begins: a seed changes something real, alike for all rows, and solvable."""

from pathlib import Path

import pytest

from karma.bench.days import Days, drawn, faults
from karma.contracts import Task
from karma.methods.tour import explore_room
from karma.tasks.files import load_tasks
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
def test_every_task_can_be_done_and_is_not_done_yet_at_each_seed(days, kind):
    for number, task in enumerate(task for task in TASKS.values() if task.kind == kind):
        world = EmbeddedWorld()
        days.of(world, task, 1 + number % 4).reset(task.scene.source)
        assert not faults(world, task), task.id


def test_a_start_with_a_fault_is_drawn_again(days):
    """The first draw of this task and seed leaves the expert with something out of reach."""
    task = TASKS["composite-07"]
    world = EmbeddedWorld()
    drawn(world, task, 2, 0)
    assert faults(world, task)
    days.of(world, task, 2).reset(task.scene.source)
    assert not faults(world, task)


def test_faults_that_the_scene_has_anyway_are_not_held_against_a_start():
    """A task that nobody can do still starts: the expert row shows that it cannot be done."""
    bad = TASKS["simple-01"]
    impossible = Task(
        id="never", kind="simple", scene=bad.scene,
        subtasks=(bad.subtasks[0], TASKS["simple-13"].subtasks[0]),
    )  # fmt: skip
    world = EmbeddedWorld()
    world.reset(impossible.scene.source)
    assert ("hard", 1) in faults(world, impossible)
    here = Days().of(world, impossible, 1)
    assert here.reset(impossible.scene.source)
    assert faults(world, impossible) == {("hard", 1)}
