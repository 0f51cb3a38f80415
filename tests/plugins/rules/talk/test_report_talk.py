"""The page of a conversation."""

import re

from support.run_files import karma
from support.talking import STORE, agent_saying

from karma.journal.records import TURNS, read_turns


def test_page_of_a_conversation_has_what_was_said_and_judges_nothing(tmp_path):
    agent = agent_saying(tmp_path, [STORE, "refuse('deed')\n"])
    for said in ("where is the apple?", "put the apple in the fridge", "sing"):
        agent.do(said)
    turns = read_turns(agent.folder)
    assert [(one.said, one.status, one.instruction) for one in turns] == [
        ("where is the apple?", "answered", None),
        ("put the apple in the fridge", "done", 0),
        ("sing", "refused", 1),
    ]
    karma("report", agent.folder)
    page = (agent.folder / "report.html").read_text()
    assert re.findall(r'<section id="(\w+)">', page) == ["conversation", "replay", "run"]
    assert "the apple is in the fridge: seen" in page
    (agent.folder / TURNS).write_text('[{"said": 1}]')
    assert TURNS in karma("report", agent.folder, code=1)
