"""How commands end: exit codes, closed pipes, logs, and what is left when they are stopped."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from support.needs import need_models
from support.paths import ROOT
from typer.testing import CliRunner

from karma.cli import app, shared
from karma.journal.records import read_records

KARMA = (sys.executable, "-P", "-m", "karma")
CODES = {
    "open the fridge": 0,
    "play the piano": 3,
    "open the laptop, then put the laptop in the sink": 4,
}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    need_models("karma-nano")
    monkeypatch.chdir(tmp_path)


def karma(*words, typed="", **environment):
    """A command as a shell runs it."""
    return subprocess.run(
        [*KARMA, *map(str, words)], input=typed, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip


@pytest.mark.parametrize(("said", "code"), CODES.items())
def test_run_ends_with_what_came_of_it(said, code, tmp_path):
    shown = CliRunner().invoke(app, ["run", said, "--json", str(tmp_path / "x.json")])
    assert shown.exit_code == code, shown.output
    told = json.loads((tmp_path / "x.json").read_text())
    assert told["exit_code"] == code
    assert told["status"] == {0: "done", 3: "refused", 4: "unfinished"}[code]
    assert told["scene"] == "kitchen_1"
    assert (tmp_path / told["run"] / "episodes.jsonl").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("run", "open the fridge", "--no-such"), ("run", "open", "the", "fridge"),
        ("run", "open the fridge", "--people", "9"), ("evil", "demo"), ("eval",),
        ("chat", "--scene"),
    ],
)  # fmt: skip
def test_misuse_is_two(words):
    shown = CliRunner().invoke(app, list(words))
    assert shown.exit_code == 2
    if words[:2] == ("run", "open"):
        assert 'karma run "open the fridge"' in " ".join(shown.output.split())


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["open the fridge", "/memory"], 0),
        (["play the piano", "open the fridge"], 3),
        (["play the piano", "open the laptop, then put the laptop in the sink"], 4),
        ([], 0),
    ],
)
def test_conversation_from_a_pipe_ends_with_the_worst(lines, code):
    shown = CliRunner().invoke(app, ["chat"], input="\n".join(lines) + "\n" * bool(lines))
    assert shown.exit_code == code, shown.output


def test_errors_are_one(tmp_path):
    assert karma("table", "nowhere").returncode == 1
    for words in (["eval", "nowhere.toml"], ["run", "x", "--scene", "atlantis"]):
        assert CliRunner().invoke(app, words).exit_code == 1


def test_small_ways_in():
    def said(*words):
        return CliRunner().invoke(app, list(words)).stdout

    assert "Usage" in said("-h") and "Usage" in said("world", "list", "-h")
    figures = CliRunner().invoke(app, ["run", "open the fridge", "--json", "-"])
    assert json.loads(figures.stdout)["status"] == "done"
    assert "the fridge is open: seen" in figures.stderr


def test_log_of_a_request_is_cut_nowhere():
    said = CliRunner().invoke(app, ["run", "put the fridge into the microwave and the toaster"])
    assert "…" not in said.output and "more" not in said.output.split()


def test_log_of_a_run_says_how_far_it_is(monkeypatch):
    monkeypatch.setattr(shared.console, "width", 30)
    words = ["eval", "demo", "--limit", "2", "--out", "run", "--workers", "1"]
    done = CliRunner().invoke(app, words)
    lines = [line for line in done.stdout.splitlines() if " of 4: " in line]
    assert lines[-1] == "4 of 4: episodes" and len(lines) >= 2, done.stdout


@pytest.mark.parametrize("where", [".", "/", "elsewhere"])
def test_rooms_of_a_task_file_lie_beside_it(tmp_path, monkeypatch, where):
    place = tmp_path / "bench"
    place.mkdir()
    (tmp_path / "elsewhere").mkdir()
    shutil.copy(ROOT / "karma/world/scenes/kitchen_2.json", place / "my room.json")
    for name, room in (("t.jsonl", "my room.json"), ("none.jsonl", "no room.json")):
        sub = {"instruction": "Open the fridge.", "goals": ["OPEN(Fridge)"]}
        task = {"id": "a", "kind": "simple", "scene": room, "subtasks": [sub]}
        (place / name).write_text(json.dumps(task) + "\n")
    text = 'name = "e"\ntasks = "{}"\n[[rows]]\nname = "e"\nmethod = "expert"\n'
    for name in ("t", "none"):
        (place / f"{name}.toml").write_text(text.format(f"{name}.jsonl"))
    monkeypatch.chdir(where if where == "/" else tmp_path / where)
    for name, code in (("t", 0), ("none", 1)):
        words = ["eval", str(place / f"{name}.toml"), "--out", str(tmp_path / f"run-{name}")]
        shown = CliRunner().invoke(app, [*words, "--workers", "1"])
        assert shown.exit_code == code, shown.output
    assert f"beside {place / 'none.jsonl'}" in " ".join(shown.output.split())
    (record,) = read_records(tmp_path / "run-t" / "episodes.jsonl")
    assert (record.scene, record.success) == ("my room", True)


@pytest.mark.parametrize(("method", "code"), [("expert", 0), ("idle", 4)])
def test_success_rate_below_the_floor_ends_with_four(tmp_path, method, code):
    file = tmp_path / "e.toml"
    tasks = ROOT / "eval/alfred_l/tasks.jsonl"
    file.write_text(
        f'name = "e"\ntasks = "{tasks}"\nonly = ["simple-03"]\n'
        f'[[rows]]\nname = "row"\nmethod = "{method}"\n'
    )
    words = ["eval", str(file), "--out", str(tmp_path / "run"), "--workers", "1"]
    shown = CliRunner().invoke(app, [*words, "--fail-under", "0.5"])
    assert shown.exit_code == code, shown.output


# ----------------------------------------------------------------- stopped


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_conversation_that_is_ended_from_outside_keeps_what_was_done(tmp_path, number):
    process = subprocess.Popen(
        [*KARMA, "chat", "--out", "out"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # noqa: PLW1509 - under nohup
    )  # fmt: skip
    process.stdin.write("open the fridge\n")
    process.stdin.flush()
    while "seen" not in process.stdout.readline():
        pass
    time.sleep(0.5)  # until it reads again
    process.send_signal(number)
    assert process.wait(60) == 130
    (record,) = read_records(tmp_path / "out/episodes.jsonl")
    assert record.subtasks[0].finished
