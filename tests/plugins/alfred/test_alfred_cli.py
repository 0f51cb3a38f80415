"""`karma world import-trials` and `karma world replay`: lines, files, refusals."""

import json

import pytest
from support import alfred_kitchen as ours
from typer.testing import CliRunner

from karma.cli import app
from karma.world.core import scene as scenes
from karma.world.sim import EmbeddedWorld


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("KARMA_SHARED", str(tmp_path / "nowhere"))
    monkeypatch.setenv("COLUMNS", "120")


@pytest.fixture
def trials(tmp_path):
    """Three demonstrations, the second of which lacks a step."""
    rows = [ours.trial() | {"id": f"ours_{number}"} for number in range(3)]
    rows[1]["plan"]["low_actions"].pop(8)
    return ours.write(tmp_path / "trials.jsonl.gz", *rows)


def karma(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result.output


def test_replay_names_what_fails_and_counts_in_the_last_line(trials, tmp_path):
    text = karma("world", "replay", trials, "--json", tmp_path / "out.json").splitlines()
    assert text[0].startswith("ours_1 FloorPlan7 action 8: is at loc|3|-2|1|30, the planner's")
    assert text[-2] == "actions on objects 8, in view 8 (100.0 %)"
    assert text[-1] == "trials 3, ok 2"
    report = json.loads((tmp_path / "out.json").read_text())
    assert (report["trials"], report["ok"]) == (3, 2)
    assert [(row["id"], row["ok"]) for row in report["results"]] == [
        ("ours_0", True), ("ours_1", False), ("ours_2", True),
    ]  # fmt: skip
    assert report["results"][1]["step"] == 8


def test_replay_with_workers_and_several_files_says_the_same(trials):
    one = karma("world", "replay", trials, trials)
    assert one == karma("world", "replay", trials, trials, "--workers", 2)
    assert one.splitlines()[-1] == "trials 6, ok 4"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.jsonl"], "missing.jsonl: No such file"),
        (["TRIALS", "--layouts", "missing.json"], "missing.json: No such file"),
        (["TRIALS", "--only", "ours_9"], "no trial 'ours_9'"),
    ],
)
def test_replay_of_what_is_not_there_is_refused(trials, arguments, said):
    given = [str(trials) if one == "TRIALS" else one for one in arguments]
    text = karma("world", "replay", *given, code=1)
    assert said in text
    assert "Traceback" not in text


def test_import_alfred_writes_scenes_that_load_and_replay(trials, tmp_path):
    out, report = tmp_path / "scenes", tmp_path / "out.json"
    text = karma(
        "world", "import-trials", trials, "--only", "ours_0", "--out", out, "--json", report
    )
    assert "1 scenes in" in text
    (row,) = json.loads(report.read_text())
    assert (row["trial"], row["scene"]) == ("ours_0", ours.PLAN)
    world = EmbeddedWorld(scenes.load(row["path"]))
    assert world.last_event.get_object(ours.APPLE)["parentReceptacles"][0] == ours.TABLE
