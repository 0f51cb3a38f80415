"""The sequences of `eval/alfworld_r`: each task can be done when its turn comes.

Every fifth sequence; KARMA_ALL_SEQUENCES=1 takes all 15.
"""

import os

from support.paths import ROOT

from karma.bench.engine.episode import run_episode
from karma.bench.methods.expert import ExpertMethod
from karma.goals.files import load_tasks
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

COMMITTED = ROOT / "eval" / "alfworld_r" / "tasks.jsonl"


def test_committed_sequences_are_still_done_by_the_expert(tmp_path):
    """The skills by which the expert acts may change: then what it can do may, too."""
    tasks = load_tasks(COMMITTED)
    assert len(tasks) == 15
    for task in tasks[:: 1 if os.environ.get("KARMA_ALL_SEQUENCES") else 5]:
        record = run_episode(
            ExpertMethod(), Home(EmbeddedWorld), task, row="expert", seed=0, folder=tmp_path
        )
        assert not [sub.instruction for sub in record.subtasks if sub.unmet], task.id
        assert len(record.subtasks) == len(task.subtasks), record.error
