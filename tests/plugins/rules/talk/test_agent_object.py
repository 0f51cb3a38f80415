"""`from karma import Agent`: one path for Python, `karma run` and `karma chat`."""

import gc
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from support.run_files import files
from support.talking import AWAY, STORE, TAKE, WASH, agent_saying
from support.tiny import export_tiny

from karma import Agent
from karma.assistant.agent import asking
from karma.assistant.talk_folder import TalkFolder
from karma.errors import FileError, KarmaError
from karma.journal.folder import EPISODES, MARK, RESULTS
from karma.journal.run_folder import read_run
from karma.journal.steps import read_steps, steps_path
from karma.loading.models import Models


def everything(agent, folder):
    """All bytes that an agent leaves, and what it remembers."""
    maps = (folder / "maps" / "handmade.json").read_bytes()
    return files(agent.folder), maps, repr(agent.memory), repr(agent.map), agent._part.steps.data()


def test_package_is_light_and_still_has_the_agent():
    code = "import sys, karma; print('numpy' in sys.modules, 'Agent' in karma.__all__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
    from karma.assistant.agent import Agent as same

    assert Agent is same


def test_reply_is_true_where_all_was_done_and_reads_like_the_terminal(tmp_path):
    agent = agent_saying(tmp_path, [STORE])
    reply = agent.do("put the apple in the fridge")
    assert reply
    assert repr(reply).splitlines()[0] == "put the apple in the fridge"
    assert "  the apple is in the fridge: seen" in repr(reply).splitlines()
    assert "1 said" in repr(agent)


def test_several_requests_at_once_are_parts_of_one_reply(tmp_path):
    reply = agent_saying(tmp_path, [TAKE + WASH, "refuse('deed')\n"]).do(
        "wash the apple, then paint the wall"
    )
    assert [part.status for part in reply.parts] == ["done", "refused"]
    assert reply.status == "refused" and not reply


def test_undo_brings_back_the_same_bytes(tmp_path):
    agent = agent_saying(tmp_path, [TAKE + WASH, STORE, STORE])
    agent.do("wash the apple")
    event, before = agent._world.last_event, everything(agent, tmp_path)
    agent.do("put it in the fridge")
    after = everything(agent, tmp_path)
    assert after != before
    assert agent.undo() == "put it in the fridge"
    assert everything(agent, tmp_path) == before
    assert agent._world.last_event is event
    agent.do("put it in the fridge")
    assert everything(agent, tmp_path) == after


def test_request_that_fails_leaves_all_as_it_was_before_it_and_those_before_stay(tmp_path):
    agent = agent_saying(tmp_path, [TAKE + WASH])  # the script runs out at the second request
    with pytest.raises(KarmaError, match="run out"):
        agent.do("wash the apple, then open the cabinet")
    assert [len(reply.parts) for reply in agent.replies] == [1]
    assert len(agent._done) == 1 and len(agent.memory) > 0
    agent.undo()
    with pytest.raises(KarmaError, match="run out"):
        agent.do("open the cabinet")
    assert len(agent.memory) == 0 and agent.replies == [] and agent._done == []


def test_run_is_read_like_any_other(tmp_path):
    agent = agent_saying(tmp_path, [TAKE, AWAY])
    agent.do("take the apple")
    agent.do("put it in the fridge")
    run = read_run(agent.folder)
    (record,) = run.records
    assert [one.instruction for one in record.subtasks] == [
        "take the apple",
        "put it in the fridge",
    ]
    assert record.unjudged
    assert run.header.models["planner"] == "scripted"
    assert len(read_steps(steps_path(agent.folder, *record.key))) > 10
    assert (agent.folder / "maps" / "handmade.json").exists()


def test_talk_that_was_edited_is_believed_by_nobody(tmp_path):
    agent = agent_saying(tmp_path, [TAKE, AWAY])
    for said in ("take the apple", "put it in the fridge"):
        agent.do(said)
        for name in (EPISODES, RESULTS):
            place = agent.folder / name
            whole = place.read_bytes()
            for edited in (whole.replace(b"[", b"[ ", 1), whole[:1], b""):
                place.write_bytes(edited)
                with pytest.raises(FileError, match=f"{name}: is not as it was left"):
                    read_run(agent.folder)
            place.write_bytes(whole)
        assert len(read_run(agent.folder).records) == 1


def test_talk_that_was_killed_while_it_was_written_is_read(tmp_path):
    agent = agent_saying(tmp_path, [TAKE, AWAY])
    agent.do("take the apple")
    mark = (agent.folder / MARK).read_bytes()
    agent.do("put it in the fridge")
    (agent.folder / RESULTS).unlink()  # which goes first and comes last
    (agent.folder / MARK).write_bytes(mark)
    (record,) = read_run(agent.folder).records
    assert len(record.subtasks) == 2
    assert not read_run(agent.folder).finished


def test_same_talk_twice_leaves_the_same_bytes(tmp_path):
    left = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        agent = agent_saying(tmp_path / name, [TAKE, AWAY])
        agent.do("take the apple")
        agent.do("put it in the fridge")
        left.append(files(agent.folder))
    for name in left[0]:
        assert name == "header.json" or left[0][name] == left[1][name], name
    assert left[0].keys() == left[1].keys()


def test_place_is_the_first_folder_that_is_free(tmp_path):
    (tmp_path / "kitchen_1-1").mkdir()
    places = [TalkFolder(None, "kitchen_1", tmp_path) for _ in range(2)]
    assert [one.folder.name for one in places] == ["kitchen_1-2", "kitchen_1-3"]


def test_conversations_begun_at_once_have_a_folder_each(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        places = list(pool.map(lambda _: TalkFolder(None, "kitchen_1", tmp_path), range(40)))
    assert len({one.folder for one in places}) == 40


def test_two_conversations_at_once_in_one_folder_are_refused(tmp_path):
    agent = agent_saying(tmp_path, [TAKE])
    with pytest.raises(KarmaError, match="another run is at work in this folder"):
        agent_saying(tmp_path, [TAKE])
    agent.do("take the apple")
    before = files(agent.folder)
    folder = agent.folder
    del agent
    gc.collect()
    with pytest.raises(FileError, match="holds another conversation"):
        agent_saying(tmp_path, [TAKE])
    assert files(folder) == before


def test_conversation_in_which_nothing_was_said_leaves_no_folder(tmp_path):
    given = tmp_path / "given"
    given.mkdir()
    places = [TalkFolder(one, "kitchen_1", tmp_path) for one in (None, tmp_path / "new", given)]
    for one in places:
        one.leave()
    assert list(tmp_path.rglob("*")) == [given]


def test_nothing_said_is_refused(tmp_path):
    with pytest.raises(KarmaError, match="what to do"):
        agent_saying(tmp_path, []).do("  ")


def test_big_planner_is_told_how_to_refuse_unless_that_is_said_otherwise(tmp_path):
    planner = str(export_tiny(tmp_path / "tiny.gguf"))

    def refusing(**said):
        return asking(Models(planner=planner, **said)).refusing

    assert refusing(profile="full") is True
    assert refusing() is True  # a GGUF by its path has the full prompt
    assert refusing(profile="full", refusing=False) is False
    assert refusing(profile="compact") is None  # who has learnt it does
