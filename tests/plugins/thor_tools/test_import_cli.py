"""`karma world import`: what it prints and writes."""

import json

import pytest
from typer.testing import CliRunner

from karma.cli import app
from karma.world.core import scene as scenes
from karma.world.sim import EmbeddedWorld


def karma(*words):
    """The exit code of a command and what it said."""
    done = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "160"})
    return done.exit_code, done.output


@pytest.fixture
def dump(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    objects = EmbeddedWorld("bathroom_1").last_event.metadata["objects"]
    path = tmp_path / "dump.jsonl"
    path.write_text(json.dumps({"scene": "FloorPlan401", "objects": list(objects)}) + "\n")
    return path


def test_world_import_writes_scenes_that_load(dump, tmp_path):
    report = tmp_path / "report.json"
    code, text = karma("world", "import", dump, "--out", tmp_path / "scenes", "--json", report)
    assert code == 0, text
    assert "1 scenes" in text
    (row,) = json.loads(report.read_text())
    found = scenes.load(row["path"])
    ours = scenes.load("bathroom_1")
    assert (found.name, found.room) == ("FloorPlan401", "Bathroom")
    assert {thing.id for thing in found.objects} == {thing.id for thing in ours.objects}
    assert "FloorPlan401" in karma("world", "show", row["path"])[1]


def test_world_import_of_a_name_that_is_not_there_is_refused(dump, tmp_path):
    code, text = karma(
        "world", "import", dump, "--only", "FloorPlan2", "--out", tmp_path / "scenes"
    )
    assert code == 1, text
    assert "dump.jsonl: no scene named 'FloorPlan2'" in text
    assert not (tmp_path / "scenes").exists()
