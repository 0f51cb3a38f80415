"""EB-ALFRED over ALFRED's demonstrations: which of the expert's plans its actions carry out."""

import pytest
from support.eb_alfred import expert_result, shared_half

from karma.world.eb_alfred.actions import actions_in
from karma.world.eb_alfred.environment import Environment

pytestmark = pytest.mark.shared


def test_expert_plans_of_the_half_all_succeed():
    tasks, rooms, types = shared_half()
    failed = {}
    for one in sorted({task.trial for task in tasks}):
        trial = rooms.trials[one]
        met, refused = expert_result(trial, rooms.facts[trial.scene.floor_plan], types)
        if not met:
            failed[one] = refused
    assert failed == {}


def test_actions_of_every_room_begin_with_the_same_162():
    tasks, rooms, types = shared_half()
    counts = set()
    for one in sorted({task.trial for task in tasks})[::8]:
        trial = rooms.trials[one]
        env = Environment(trial, rooms.facts[trial.scene.floor_plan], types)
        names = [str(action) for action in env.actions]
        assert names[:162] == [str(action) for action in actions_in(types, ())]
        assert len(set(names)) == len(names)
        counts.add(len(names))
    assert min(counts) >= 162
    assert max(counts) > 200
