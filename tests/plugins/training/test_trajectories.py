"""Trajectories of tool mode: what they hold, and that they come true when they are replayed."""

from collections import Counter

import numpy as np
import pytest
from support.experiences import Words
from support.paths import ROOT

from karma.agent.karma import KarmaMethod
from karma.agent.planning.planner import Planner
from karma.agent.tools.table import ENDS, parse_answer
from karma.bench.engine.episode import drawn
from karma.files import to_json
from karma.goals.files import load_said
from karma.memory.recall import CosineRecall
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.plugins.training import trajectories
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.packs import Data, Unseen
from karma.plugins.training.task_files import fresh_rooms
from karma.plugins.training.tool_requests import SHARES, slipped
from karma.plugins.training.tool_teacher import things_told
from karma.plugins.training.trajectories import ToolMaterial, draw_chats
from karma.types.events import Outcome
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.sim import EmbeddedWorld

COUNT = 16


@pytest.fixture(scope="module")
def material():
    written = load_said(ROOT / "eval" / "requests" / "written.jsonl")
    data = Data(rooms=(), book=our_book().part(held_out=False), unseen=Unseen(), written=written)
    recall = CosineRecall(Words(), text="sentence")
    return ToolMaterial(data=data, scenes=list(fresh_rooms(3, 8)), recall=recall)


@pytest.fixture(scope="module")
def talks(material, tmp_path_factory):
    """Conversations by name."""
    folder = tmp_path_factory.mktemp("rooms")
    return {str(n): list(draw_chats(material, folder, 0, str(n))) for n in range(COUNT)}


def texts(chat, role):
    return [one["content"] for one in chat["messages"] if one["role"] == role]


def test_chats_are_turns_that_close_with_an_end(talks):
    chats = [chat for talk in talks.values() for chat in talk]
    assert len(chats) > COUNT
    for chat in chats:
        roles = [message["role"] for message in chat["messages"]]
        assert roles == ["system", *("user", "assistant") * (len(roles) // 2)]
        assert "Request: " in texts(chat, "user")[0]
        assert parse_answer(texts(chat, "assistant")[-1]).end is not None
        assert chat["messages"][-1].get("weight", 1) == 1
    assert len(Counter(chat["kind"] for chat in chats)) > 4


def test_equal_seeds_give_equal_chats(material, talks, tmp_path):
    again = list(draw_chats(material, tmp_path, 0, "0"))
    assert to_json(again) == to_json(talks["0"])


@pytest.mark.parametrize("source", SHARES)
def test_every_source_gives_chats(material, tmp_path, monkeypatch, source):
    monkeypatch.setattr(trajectories, "SHARES", {source: 1.0})
    drawn_chats = (draw_chats(material, tmp_path, 1, str(number)) for number in range(12))
    found = any(list(chats) for chats in drawn_chats)
    assert found != (source == "alfred")  # there are no sentences of ALFRED's here


def test_replayed_chats_come_to_the_same_results_and_ends(talks, tmp_path, material, monkeypatch):
    worlds = []

    def noted(world, task, seed, draw):
        worlds.append((task.scene, task.id))
        return drawn(world, task, seed, draw)

    monkeypatch.setattr(trajectories, "drawn", noted)
    monkeypatch.setattr(trajectories, "NO_MAP", 0.0)
    for name in ("3", "4", "5", "6"):
        talk = list(draw_chats(material, tmp_path, 0, name))
        scene, task_id = worlds[-1]
        world = EmbeddedWorld(scene.path)
        drawn(world, Task(id=task_id, kind="simple", scene=scene, subtasks=()), 0, 0)
        model = ScriptedModel(answer for chat in talk for answer in texts(chat, "assistant"))
        method = KarmaMethod(Planner(model, "tools"), material.recall, MetadataVision())
        agent = method.begin(world, SceneRef.of(scene.path), seed=0, folder=tmp_path)
        for chat in talk:
            said = texts(chat, "user")[0].rpartition("Request: ")[2]
            *_, outcome = agent.do(SubTask(instruction=said))
            assert isinstance(outcome, Outcome)
            assert outcome.end == parse_answer(texts(chat, "assistant")[-1]).end
        shown = [text for chat in talk for text in texts(chat, "user")]
        assert [prompt.changing for prompt in model.prompts] == shown


@pytest.mark.parametrize(
    ("messages", "places", "held"),
    [
        (["Seen: Fridge: Apple, Egg (broken); Cabinet_2 (opened)\nIn the hand: Mug"],
         {"Apple": "Fridge", "Egg": "Fridge", "Cabinet_2": None}, "Mug"),
        (["Seen: Sink: Cup, Cup_2\nRemembered, the last used last: Pan at Sink; *Pot at Shelf_1"],
         {"Pot": "Shelf_1", "Pan": "Sink", "Cup": "Sink", "Cup_2": "Sink"}, "nothing"),
        (["Seen: Desk: Pen, Mug_2 to Mug_4", "pick(Pen) -> ok. Seen: no longer there: Mug_3"],
         {"Pen": "Desk", "Mug_2": "Desk", "Mug_4": "Desk"}, "Pen"),
        (["pick(Pen) -> ok\nput(Pen, Desk) -> ok. Seen: Desk: Pen"], {"Pen": "Desk"}, "nothing"),
    ],
)  # fmt: skip
def test_teacher_reads_what_messages_tell(messages, places, held):
    things, in_hand = things_told("\n".join(messages))
    assert list({name: thing.place for name, thing in things.items()}.items()) == list(
        places.items()
    )
    assert in_hand == held


def test_slip_changes_a_call_and_never_the_end():
    lines = ["pick(Apple)", "open(Fridge)", "put(Apple, Fridge)", 'done("It is in the fridge.")']
    for seed in range(30):
        spoiled = slipped(np.random.default_rng(seed), lines)
        assert spoiled != lines and spoiled[-1] == lines[-1]
    for end in ENDS:
        assert slipped(np.random.default_rng(0), [f'{end}("It is.")']) == [f'{end}("It is.")']
