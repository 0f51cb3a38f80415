"""A text of several requests that is stopped, and requests that follow each other in a home."""

import pytest
from support.needs import need_models

from karma import Agent
from karma.errors import KarmaError
from karma.journal.records import read_records
from karma.types.events import SkillResult


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    need_models("karma-nano")
    monkeypatch.chdir(tmp_path)


SAID = "open the fridge, then close the fridge, then slice the bread"


def stopped(agent, at, error):
    """Raise an error while the agent carries out its `at`-th request."""
    done = 0
    moments = agent.doing(SAID)
    for moment in moments:
        done += not isinstance(moment, SkillResult) and hasattr(moment, "checks")
        if done == at - 1 and isinstance(moment, SkillResult):
            with pytest.raises(type(error)):
                moments.throw(error)
            return


@pytest.mark.parametrize("error", [KeyboardInterrupt(), KarmaError("the server is gone")])
@pytest.mark.parametrize("at", [1, 2, 3])
def test_what_was_finished_stays_when_the_rest_is_stopped(tmp_path, at, error):
    agent, calm = Agent(folder=tmp_path / "a"), Agent(folder=tmp_path / "b")
    start = agent._world.last_event.metadata
    stopped(agent, at, error)
    clauses = SAID.split(", then ")[: at - 1]
    for clause in clauses:
        calm.do(clause)
    kept = agent.replies[-1].parts if agent.replies else ()
    assert [part.instruction for part in kept] == clauses
    assert agent._world.last_event.metadata["objects"] == calm._world.last_event.metadata["objects"]
    assert agent.memory.lines() == calm.memory.lines()
    if at > 1:
        assert agent.replies[-1].status == "unfinished"
        assert agent.replies[-1].stopped == SAID.split(", then ")[at - 1]
        (record,) = read_records(tmp_path / "a" / "episodes.jsonl")
        assert [one.instruction for one in record.subtasks] == clauses
    else:
        assert not (tmp_path / "a" / "episodes.jsonl").exists()
    assert agent.undo() == (SAID if at > 1 else None)
    assert agent._world.last_event.metadata["objects"] == start["objects"]


@pytest.mark.parametrize("scene", ["kitchen_1", "kitchen_2", "kitchen_3", "kitchen_4"])
def test_apple_in_a_bowl_in_the_fridge_is_fetched_as_fast_as_without_the_bowl(scene, agent_in):
    steps, searched = {}, {}
    for way, first in (("bowl", "put the apple in the bowl"), ("alone", "")):
        agent = agent_in(scene, way)
        if first:
            agent.do(first)
        agent.do("put the bowl in the fridge" if first else "put the apple in the fridge")
        reply = agent.do("put the apple on the counter top")
        results = reply.parts[-1].results
        put = max(n for n, one in enumerate(results) if one.call.skill == "PutObject")
        steps[way] = sum(one.actions for one in results[: put + 1])  # then the fridge is shut
        searched[way] = sum(one.explorations for one in results)
    assert steps["bowl"] <= 10  # it stands elsewhere, since it shut the fridge before
    assert searched["bowl"] <= searched["alone"]
