"""The tasks that need looking: twins that differ in which of two things is in a state."""

from collections import Counter

import pytest
from support.paths import ROOT

from karma.agent.perceive import truth_of
from karma.files import to_json
from karma.tasks.drawing.looking import LEFT, draw_twins
from karma.tasks.files import load_tasks
from karma.tasks.goals import GoalTracker
from karma.world.sim import EmbeddedWorld


def drawn(kind, count=20):
    return next(filter(None, (draw_twins(kind, n, 5, "rooms/{}.json") for n in range(count))))


def states(scene):
    event = EmbeddedWorld(scene).last_event
    return {one.object_id: one.states for one in truth_of(event).objects}


@pytest.mark.parametrize("kind", LEFT)
def test_twins_differ_in_the_state_of_two_things_of_a_type_and_in_the_goal_alone(kind):
    one, other = drawn(kind)
    a, b = states(one.scene), states(other.scene)
    changed = {name for name in a if a[name] != b[name]}
    types = Counter(name.partition("|")[0] for name in changed)
    assert set(types.values()) == {2}
    assert one.scene.agent == other.scene.agent
    said = [[sub.instruction for sub in twin.task.subtasks] for twin in (one, other)]
    assert said[0] == said[1]
    goals = [twin.task.subtasks[-1].goals for twin in (one, other)]
    assert goals[0] != goals[1]
    for twin in (one, other):
        assert LEFT[kind].word in states(twin.scene)[thing(twin, changed)]


def thing(twin, changed):
    """The one of the changed things that the task's last goal names."""
    goal = str(twin.task.subtasks[-1].goals[0])
    return next(name for name in sorted(changed, key=len, reverse=True) if name in goal)


def test_agent_stands_before_both_things():
    for twin in drawn("dirty"):
        event = EmbeddedWorld(twin.scene).last_event
        seen = Counter(one.object_type for one in truth_of(event).objects if one.visible)
        meant = thing(twin, set(states(twin.scene)))
        assert seen[meant.partition("|")[0]] >= 2


def test_equal_seeds_give_equal_bytes():
    first, again = drawn("drawer"), drawn("drawer")
    assert [to_json(one.scene) for one in first] == [to_json(one.scene) for one in again]
    assert [one.task for one in first] == [one.task for one in again]


def test_shipped_tasks_are_twins_in_rooms_that_are_there_and_none_is_done_at_the_start(monkeypatch):
    monkeypatch.chdir(ROOT)
    tasks = load_tasks("eval/looking/tasks.jsonl")
    assert len(tasks) == 60
    pairs = Counter(task.id[:-1] for task in tasks)
    assert set(pairs.values()) == {2}
    rooms = {path.name for path in (ROOT / "eval/looking/rooms").iterdir()}
    assert rooms == {f"{task.scene.name}.json" for task in tasks}
    world = EmbeddedWorld()
    for task in tasks[::3]:
        tracker = GoalTracker()
        tracker.start(world.reset(task.scene.source))
        assert tracker.unmet(task.subtasks[-1].goals, world.last_event), task.id
