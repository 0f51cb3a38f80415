"""What is kept of hosted answers in a run, and runs that do not begin."""

import json
from pathlib import Path

import pytest
from support.hosted_server import plant_key, real_server, wire_server
from support.paths import ROOT
from typer.testing import CliRunner

from karma.bench.engine.run import Run
from karma.cli import app
from karma.journal.records import read_records
from karma.plugins.hosted.cassette import Cassette
from karma.testing import make_planner

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
FREE = "Of course! GoToObject(robot, 'Fridge') comes first."
CUT = "GoToObject(robot, 'Fridge')\nOpenObj"
TALK = "Sure!\n1. GoToObject(robot, 'Fridge')\n2. OpenObject(robot, 'Fridge')\n"


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


def experiment(path, url, *, models="", planner=""):
    path.write_text(
        f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-12"]\n[[rows]]\nname = "hosted"\n'
        f'[models]\nplanner = "openai"\nprofile = "full"\n{models}'
        f'[models.hosted.planner]\nbase_url = "{url}"\nmodel = "tiny"\n{planner}'
    )
    return path


def test_refused_answers_are_kept_with_their_prompts_and_quoted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    texts = iter([(FREE, "stop"), (CUT, "length"), (TALK, "stop")])

    def answer(*_):
        text, finish = next(texts)
        message = {"content": text, "reasoning_content": "The fridge."}
        choice = {"message": message, "finish_reason": finish}
        return 200, {}, json.dumps({"choices": [choice]}).encode()

    with wire_server(answer) as (url, seen):
        done = CliRunner().invoke(app, [
            "run", "Open the fridge.", "--planner", "openai", "--base-url", url, "--model", "m",
            "--mode", "full", "--set", "models.constraint=free", "--json", "x.json",
        ])  # fmt: skip
    assert done.exit_code == 0, done.output
    (line,) = json.loads(Path("x.json").read_text())["instructions"]
    first, second, third = line["answers"]
    assert [one["program"] for one in line["answers"]] == [FREE, CUT, TALK]
    assert "not a program" in first["error"]
    assert "the answer was cut off" in second["error"]
    for (_, body, _), one in zip(seen, line["answers"], strict=True):
        assert body["messages"][-1]["content"].endswith(one["prompt"])
        assert "pen the fridge" in one["prompt"]
    assert (third["error"], third["dropped"]) == ("", ["Sure!"])
    assert {one["reasoning"] for one in line["answers"]} == {"The fridge."}
    assert {one["constrained"] for one in line["answers"]} == {False}
    assert "cut off" in seen[2][1]["messages"][-1]["content"]
    assert {body["max_tokens"] for _, body, _ in seen} == {512}


def test_run_at_a_real_server_says_that_a_grammar_held_and_replays_its_canary(tmp_path):
    model = make_planner(tmp_path / "tiny.gguf", "qwen3")
    with real_server(model, tmp_path, n_ctx=8192) as url:
        said = 'thinking = "on"\n'
        path = experiment(tmp_path / "x.toml", url, models=said)
        recorded = Run(path, tmp_path / "run", cassette=Cassette(tmp_path / "tape", "record"))
        list(recorded.episodes())
    replayed = Run(path, tmp_path / "again", cassette=Cassette(tmp_path / "tape", "replay"))
    assert list(replayed.episodes()) == recorded.records
    (record,) = read_records(tmp_path / "again" / "episodes.jsonl")
    answers = [answer for part in record.subtasks for answer in part.answers]
    assert answers
    assert all(answer.constrained and answer.reasoning for answer in answers)
    assert all(answer.prompt for answer in answers if answer.error)
