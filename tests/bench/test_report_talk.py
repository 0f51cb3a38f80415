"""The page of a conversation: the replay and what was said, and nothing that only judges."""

import re
from dataclasses import replace

import pytest
from bench.test_report import Text
from support.run_files import karma, write_experiment
from support.talking import STORE, agent_saying

from karma.agent.journal.records import TURNS, read_turns
from karma.agent.journal.run_folder import read_run
from karma.bench.engine.run import Run
from karma.bench.figures.results import result_of
from karma.bench.report.html import Frames
from karma.bench.report.page import page_of, render


@pytest.fixture
def talked(tmp_path):
    agent = agent_saying(tmp_path, [STORE, "refuse('deed')\n"])
    for said in ("where is the apple?", "put the apple in the fridge", "sing"):
        agent.do(said)
    return agent


def test_turns_are_kept_with_the_instruction_that_each_is(talked):
    turns = read_turns(talked.folder)
    assert [(one.said, one.status, one.instruction) for one in turns] == [
        ("where is the apple?", "answered", None),
        ("put the apple in the fridge", "done", 0),
        ("sing", "refused", 1),
    ]
    assert ("seen", "the apple is in the fridge: seen") in turns[1].lines


def test_turns_that_were_undone_are_not_kept(talked):
    talked.undo()
    assert [one.said for one in read_turns(talked.folder)] == [
        "where is the apple?",
        "put the apple in the fridge",
    ]


def test_page_of_a_conversation_opens_at_the_replay_and_judges_nothing(talked):
    karma("report", talked.folder)
    page = (talked.folder / "report.html").read_text()
    sections = re.findall(r'<section id="(\w+)">', page)
    assert sections == ["replay", "turns", "run"]
    said = " ".join("".join(Text(page).said).split())
    assert "A conversation of 3 turns" in said
    assert "the apple is in the fridge: seen" in said
    assert "SR:" not in said


def test_run_whose_tasks_nobody_can_be_judged_by_is_no_conversation(tmp_path):
    path = write_experiment(
        tmp_path / "x.toml",
        "karma-nano",
        rows='[[rows]]\nname = "expert"\nmethod = "expert"\n',
        only=["simple-11"],
        more="",
    )
    run = Run(path, tmp_path / "run")
    list(run.episodes())
    found = read_run(run.folder)
    records = tuple(replace(one, unjudged="no such thing here") for one in found.records)
    page = page_of(replace(found, records=records), result_of(found, {}), [])
    assert not page.is_talk
    assert "A conversation" not in render(page, Frames())


def test_damaged_turns_are_named(talked):
    (talked.folder / TURNS).write_text('[{"said": 1}]')
    result = karma("report", talked.folder, code=1)
    assert TURNS in result
