"""A home that is kept: the same tomorrow, whole after a kill, and nobody else's meanwhile."""

import errno
import gc
import os

import msgspec
import pytest
from support.household import kitchen
from support.talking import AWAY, TAKE, agent_saying
from typer.testing import CliRunner

from karma import Agent
from karma.agent.seeing.perceive import digest_of
from karma.cli import app
from karma.errors import FileError, KarmaError, UnwritableError
from karma.files import to_json
from karma.plugins.homes.home import KeptHome, forget_home, home_folder, homes, opened

OUT = "OpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\nCloseObject(robot, 'Fridge')\n"


def left(agent):
    """All that is to be the same tomorrow."""
    room = digest_of(agent._world.last_event)
    seen = sorted(agent.known.room.seen)
    return room, repr(agent.memory), repr(agent.map), seen, agent.home.clock_s


def gone(agent):
    agent.home.leave()
    del agent
    gc.collect()


def lived(tmp_path, answers=(TAKE, AWAY)):
    """A home in which the apple was taken and put away."""
    agent = agent_saying(tmp_path, list(answers), home=tmp_path / "home")
    agent.do("take the apple")
    agent.do("put it in the fridge")
    return agent


def test_home_is_the_same_tomorrow(tmp_path):
    agent = lived(tmp_path)
    before = left(agent)
    gone(agent)
    again = agent_saying(tmp_path, [OUT], home=tmp_path / "home", later_s=3600.0)
    room, memory, plan, seen, clock = left(again)
    assert (room, memory, plan, seen) == before[:4]
    assert clock == before[4] + 3600.0
    assert "Apple in the fridge" in memory
    assert again.do("take the apple out of the fridge")


def test_without_a_home_nothing_lasts(tmp_path):
    agent = agent_saying(tmp_path, [TAKE])
    agent.do("take the apple")
    assert agent.home.folder is None
    assert len(agent.home.past) == 1
    assert not list(tmp_path.rglob("log.jsonl"))


def test_what_was_undone_is_not_there_tomorrow(tmp_path):
    agent = agent_saying(tmp_path, [TAKE, AWAY], home=tmp_path / "home")
    agent.do("take the apple")
    before = left(agent)
    agent.do("put it in the fridge")
    assert agent.undo() == "put it in the fridge"
    assert left(agent) == before
    gone(agent)
    assert left(agent_saying(tmp_path, [], home=tmp_path / "home")) == before


def test_wherever_it_was_killed_it_opens_with_all_that_was_said(tmp_path):
    """The log cut at any byte: whole lines count, as nothing was said of the others."""
    agent = lived(tmp_path)
    log, rooms = tmp_path / "home" / "log.jsonl", {2: left(agent)[0]}
    data = log.read_bytes()
    gone(agent)
    first = data.index(b"\n") + 1
    for cut in sorted(
        {0, 1, first - 1, first, first + 1, len(data) // 2, len(data) - 1, len(data)}
    ):
        log.write_bytes(data[:cut])
        again = agent_saying(tmp_path, [], home=tmp_path / "home")
        count = data[:cut].count(b"\n")
        assert len(again.home.past) == count
        assert rooms.setdefault(count, left(again)[0]) == left(again)[0]
        gone(again)
    assert len(set(rooms.values())) == 3


def test_a_damaged_line_is_named_and_nothing_is_lost(tmp_path):
    agent = lived(tmp_path)
    gone(agent)
    log = tmp_path / "home" / "log.jsonl"
    data = log.read_bytes()
    log.write_bytes(b"{]\n" + data)
    with pytest.raises(FileError, match=r"log\.jsonl: line 1: .*\n.*karma home forget"):
        KeptHome(tmp_path / "home")
    assert log.read_bytes() == b"{]\n" + data


def test_second_agent_is_told_that_somebody_is_there(tmp_path):
    agent = lived(tmp_path)
    with pytest.raises(KarmaError, match=r"another run is at work.*\n.*another --home"):
        agent_saying(tmp_path, [], home=tmp_path / "home")
    gone(agent)
    assert len(agent_saying(tmp_path, [], home=tmp_path / "home").home.past) == 2


def test_home_is_free_as_soon_as_nobody_has_the_agent(tmp_path):
    agent = agent_saying(tmp_path, [], home=tmp_path / "home")
    del agent
    agent_saying(tmp_path, [], home=tmp_path / "home").home.leave()


def test_home_of_another_scene_and_of_an_edited_one(tmp_path):
    agent = lived(tmp_path)
    gone(agent)
    with pytest.raises(KarmaError, match="not in kitchen_2"):
        KeptHome(tmp_path / "home", "kitchen_2")
    scene = kitchen()
    objects = tuple(one for one in scene.objects if one.type != "Apple")
    edited = msgspec.structs.replace(scene, objects=objects)
    (tmp_path / "handmade.json").write_bytes(to_json(edited))
    with pytest.raises(KarmaError, match="cannot be made again as it was left"):
        agent_saying(tmp_path, [], home=tmp_path / "home")


def test_forgotten_home_is_gone_and_what_is_none_is_not_removed(tmp_path):
    agent = lived(tmp_path)
    with pytest.raises(KarmaError, match="another"):
        forget_home(tmp_path / "home")
    gone(agent)
    forget_home(tmp_path / "home")
    assert not (tmp_path / "home").exists()
    (tmp_path / "mine").mkdir()
    for command in (forget_home, opened):
        with pytest.raises(KarmaError, match="there is no home"):
            command(tmp_path / "mine")
    assert (tmp_path / "mine").is_dir()


def test_a_name_is_a_home_among_all_and_a_path_is_itself(tmp_path):
    assert str(home_folder("flat")) == "runs/homes/flat"
    assert home_folder("there/flat").parts == ("there", "flat")
    assert home_folder(tmp_path) == tmp_path


def test_full_disk_undoes_the_errand_and_tears_no_line(tmp_path, monkeypatch):
    agent = agent_saying(tmp_path, [TAKE, AWAY, AWAY], home=tmp_path / "home")
    agent.do("take the apple")
    before, fsync = left(agent), os.fsync

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UnwritableError, match="No space left"):
        agent.do("put it in the fridge")
    monkeypatch.setattr(os, "fsync", fsync)
    assert left(agent) == before
    agent.do("put it in the fridge")
    after = left(agent)
    gone(agent)
    assert left(agent_saying(tmp_path, [], home=tmp_path / "home")) == after


def test_scene_file_is_found_again_from_another_folder(tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "room.json").write_bytes(to_json(kitchen()))
    monkeypatch.chdir(tmp_path)
    first = KeptHome(tmp_path / "home", "there/room.json")
    first.restore(None, None)  # nothing was done there yet
    first.leave()
    monkeypatch.chdir(tmp_path / "there")
    home = KeptHome(tmp_path / "home", "room.json")
    assert home.scene == str((tmp_path / "there" / "room.json").resolve())


def test_agent_that_could_not_begin_leaves_the_home(tmp_path):
    agent = lived(tmp_path)
    gone(agent)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(KarmaError) as refused:
        Agent(home=tmp_path / "home", folder=tmp_path / "full", maps=tmp_path / "maps")
    assert "full" in str(refused.value)
    assert len(KeptHome(tmp_path / "home").past) == 2


def test_scene_that_there_is_not_makes_no_home(tmp_path):
    with pytest.raises(KarmaError, match="nowhere_7"):
        Agent("nowhere_7", home=tmp_path / "home", maps=tmp_path / "maps")
    with pytest.raises(KarmaError, match="there is no home"):
        opened(tmp_path / "home")


def test_a_home_is_begun_before_anybody_is_in_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def karma_home(*words):
        return CliRunner().invoke(app, ["home", *words])

    begun = karma_home("new", "mine", "--scene", "bedroom_1", "--people", "2")
    assert (begun.exit_code, begun.output.split(";")[0]) == (0, "runs/homes/mine: bedroom_1")
    assert "mine" in karma_home("list").output
    assert "bedroom_1, 2 people, 0 requests" in karma_home("show", "mine").output
    again = karma_home("new", "mine")
    assert again.exit_code == 1
    assert "To fix: karma home show runs/homes/mine" in again.output
    for wrong in (["--scene", "nowhere_7"], ["--people", "99"]):
        refused = karma_home("new", "other", *wrong)
        assert refused.exit_code == 1
        assert not homes() or [one.name for one in homes()] == ["mine"]
    assert karma_home("forget", "mine").exit_code == 0
    assert homes() == []
