"""The tasks that need looking: twins that differ in which of two things is in a state."""

from collections import Counter

from support.paths import ROOT

from karma.goals.files import load_tasks
from karma.goals.goals import GoalTracker
from karma.world.sim import EmbeddedWorld


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
