"""How commands end: exit codes, closed pipes, logs, and what is left when they are stopped."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.needs import need_models
from support.paths import ROOT
from typer.testing import CliRunner

from karma import Agent
from karma.cli import app, shared
from karma.errors import KarmaError
from karma.journal.records import read_records
from karma.types.events import SkillResult

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
        ("run", "open the fridge", "--k", "0"), ("evil", "demo"), ("eval",),
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


def test_reader_that_goes_fails_nothing():
    for words in (("--help",), ("run", "open the fridge")):
        line = " ".join((*KARMA, *(f"'{word}'" for word in words)))
        done = subprocess.run(
            ["bash", "-c", f"set -o pipefail; {line} | head -1"], capture_output=True, text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    (folder,) = Path("runs/talks").iterdir()
    assert read_records(folder / "episodes.jsonl")


def test_unknown_width_is_no_width_of_nothing():
    done = karma("table", "nowhere", COLUMNS="0")
    assert "there is no run in this folder" in done.stderr
    assert len(karma("--help", COLUMNS="0").stdout) > 1000


def test_small_ways_in():
    def said(*words):
        return CliRunner().invoke(app, list(words)).stdout

    assert "Usage" in said("-h") and "Usage" in said("world", "list", "-h")
    assert said("version") == said("--version") != ""
    figures = CliRunner().invoke(app, ["run", "open the fridge", "--json", "-"])
    assert json.loads(figures.stdout)["status"] == "done"
    assert "the fridge is open: seen" in figures.stderr


def test_ascii_locale_loses_nothing(tmp_path):
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": ""}
    done = karma("run", "open the fridge in the café", "--out", "out", **plain)
    assert "Traceback" not in done.stderr, done.stderr
    (record,) = read_records(tmp_path / "out/episodes.jsonl")
    assert record.subtasks[0].instruction == "open the fridge in the café"


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
