"""EB-ALFRED played by hosted models: recorded, replayed, beside the published scores."""

import json
import re

import pytest
from support.eb_alfred import finished, hosted
from support.hosted_server import chat, plant_key, wire_server
from typer.testing import CliRunner

from karma.cli import app
from karma.journal.folder import TABLE
from karma.plugins.alfred.eb_world.actions import PUT
from karma.plugins.hosted.cassette import Cassette

ROW = 'name = "hosted"'


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


def household(path, body, headers):
    """Answers with a plan that opens the fridge first where it was told that it is shut."""
    said = [message["content"] for message in body["messages"]]
    prompt = "\n".join(one if isinstance(one, str) else one[-1]["text"] for one in said)
    numbers = dict(reversed(one) for one in re.findall(r"^(\d+): (.+)$", prompt, re.MULTILINE))
    names = ["find a Apple", "pick up the Apple", "find a Fridge", PUT]
    if "putting it at" in prompt:
        names = ["find a Fridge", "open the Fridge", PUT]
    plan = [{"action_id": int(numbers[name]), "action_name": name} for name in names]
    usage = {"prompt_tokens": 9, "completion_tokens": 9, "total_tokens": 18}
    return chat(json.dumps({"executable_plan": plan}), usage=usage)


@pytest.fixture
def answering():
    with wire_server(household) as found:
        yield found


def test_hosted_run_is_recorded_and_replayed_to_the_byte(experiment, tmp_path, answering):
    url, seen = answering
    path = experiment(hosted(url, ROW), only=["base/0", "spatial/0"])
    tape = Cassette(tmp_path / "tape", "record")
    records, first = finished(path, tmp_path / "a", cassette=tape)
    assert [(record.success, record.calls) for record in records] == [(True, 2), (True, 2)]
    asked = len(seen)
    tape = Cassette(tmp_path / "tape", "replay")
    assert finished(path, tmp_path / "b", cassette=tape)[1] == first
    assert len(seen) == asked == 4


def test_hosted_run_with_pictures_sends_them_and_the_cassette_keeps_their_names(
    experiment, tmp_path, answering
):
    url, seen = answering
    rows = hosted(url, f"{ROW}\nprompt = {{ pictures = 1 }}")
    path = experiment(rows, only=["base/0"])
    tape = Cassette(tmp_path / "tape", "record")
    records, first = finished(path, tmp_path / "a", cassette=tape)
    assert records[0].success
    picture = seen[0][1]["messages"][1]["content"][0]
    assert picture["image_url"]["url"].startswith("data:image/png;base64,")
    kept = (tmp_path / "tape" / "exchanges.jsonl").read_text()
    assert "500x500 " in kept
    assert "base64" not in kept
    tape = Cassette(tmp_path / "tape", "replay")
    assert finished(path, tmp_path / "b", cassette=tape)[1] == first


def test_table_has_rows_of_several_runs_and_the_published_ones(experiment, tmp_path, answering):
    rows = "".join(f'[[rows]]\nname = "{one}"\nplayer = "{one}"\n' for one in ("expert", "chance"))
    finished(experiment(rows), tmp_path / "ours")
    path = experiment(hosted(answering[0], ROW), only=["base/0", "spatial/0"])
    tape = Cassette(tmp_path / "tape", "record")
    finished(path, tmp_path / "recorded", cassette=tape)
    finished(path, tmp_path / "replayed", cassette=Cassette(tmp_path / "tape", "replay"))
    out = tmp_path / "table"
    command = ["table", str(tmp_path / "ours"), "--out", str(out), "--beside"]
    done = CliRunner().invoke(app, [*command, str(tmp_path / "replayed")])
    assert done.exit_code == 0, done.output
    table = (out / TABLE).read_text()
    for row in ("| **expert** | 100.0 |", "| **chance** |", "| Deep Thought | 42.0 |"):
        assert row in table
    assert "| **hosted** (2 tasks) | 100.0 |" in table
    twice = CliRunner().invoke(app, [*command, str(tmp_path / "ours")])
    assert "row 'chance' is in another of these runs" in " ".join(twice.output.split())


def test_table_refuses_runs_of_other_tasks(experiment, tmp_path, answering):
    rows = '[[rows]]\nname = "expert"\nplayer = "expert"\n'
    finished(experiment(rows), tmp_path / "ours")
    path = experiment(hosted(answering[0], ROW), tasks={"base": [("ours_1", "Cool it.")]})
    finished(path, tmp_path / "other")
    command = ["table", str(tmp_path / "ours"), "--beside", str(tmp_path / "other")]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1
    assert "its tasks or prompts are not those of" in " ".join(done.output.split())
