"""Whole runs with hosted models: recorded, then replayed with the server stopped."""

import http.client
import json
import re
import urllib.parse
from pathlib import Path

import msgspec
import pytest
from support.hosted_server import (
    KEY,
    llama_server,
    plant_key,
)
from support.needs import need_models
from support.paths import ROOT
from typer.testing import CliRunner

from karma.bench.engine.run import Run
from karma.cli import app
from karma.files import to_json
from karma.journal.records import read_records
from karma.journal.run_folder import read_run
from karma.models.endpoint import Endpoint
from karma.plugins.hosted.cassette import Begin, Cassette, line_key_of

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
DEMO = ROOT / "eval" / "hosted_demo.toml"


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


def files_below(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# ----------------------------------------------------------------- whole runs


def karma(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    assert KEY not in result.output
    return result.output


@pytest.fixture
def experiment(tmp_path, server):
    """A function that writes a small hosted experiment and returns its path."""

    def write(*, only=("simple-12", "simple-04"), role="", url=server):
        path = tmp_path / "x.toml"
        path.write_text(
            f'name = "x"\ntasks = "{TASKS}"\nonly = {list(only)}\n[[rows]]\nname = "hosted"\n'
            '[models]\nplanner = "openai"\nprofile = "compact"\nconstraint = "free"\n' + role
            + f'[models.hosted.planner]\nbase_url = "{url}"\nmodel = "nano-chat"\n'
            "prices = { input = 2.0, output = 8.0 }\n"
        )  # fmt: skip
        return path

    return write


@pytest.mark.model
def test_recorded_run_replays_the_same_bytes_with_the_server_stopped(tmp_path, monkeypatch):
    """Must show 5, with the experiment that the documents name."""
    need_models("karma-nano")
    monkeypatch.chdir(ROOT)
    (tmp_path / "server").mkdir()
    recorded, replayed, cassette = (tmp_path / name for name in ("recorded", "replayed", "tape"))
    with llama_server(tmp_path / "server", key=KEY) as url:
        demo = tmp_path / "hosted_demo.toml"
        text = DEMO.read_text().replace('model = "karma-nano"', 'model = "nano"')
        demo.write_text(text.replace('tasks = "', f'tasks = "{DEMO.parent}/'))
        karma("eval", demo, "--out", recorded, "--cassette", cassette,
              "--cassette-mode", "record", "--base-url", url)  # fmt: skip
    place = urllib.parse.urlsplit(url)
    with pytest.raises(OSError, match="refused"):
        http.client.HTTPConnection(place.hostname, place.port, timeout=5).connect()
    monkeypatch.delenv("OPENAI_API_KEY")
    before = files_below(cassette)
    said = karma("eval", demo, "--out", replayed, "--cassette", cassette)
    assert "planner nano: " in said
    assert "cost –" in said
    assert files_below(recorded) == files_below(replayed)
    assert files_below(cassette) == before
    records = read_records(replayed / "episodes.jsonl")
    assert len(records) == 3
    assert all(record.error == "" for record in records)
    assert all(part.answers for record in records for part in record.subtasks)
    timings = read_run(replayed).timings
    assert all(part.seconds > 0 for record in records for part in timings[record.key].subtasks)
    assert not any(KEY.encode() in data for data in files_below(tmp_path / "recorded").values())
    assert KEY.encode() not in before[Path("exchanges.jsonl")]


@pytest.mark.model
def test_recording_that_was_killed_goes_on_and_replays_from_the_start(experiment, tmp_path):
    role = 'embedder = "openai"\n'
    path = experiment(role=role)
    server = re.search(r'base_url = "(.*)"', path.read_text())[1]
    path.write_text(
        path.read_text() + f'[models.hosted.embedder]\nbase_url = "{server}"\nmodel = "nano-rows"\n'
    )
    folder, tape = tmp_path / "run", tmp_path / "tape"
    run = Run(path, folder, cassette=Cassette(tape, "record"))
    next(run.episodes())
    first = (folder / "episodes.jsonl").read_bytes()
    whole = (tape / "exchanges.jsonl").read_bytes()
    (folder / "episodes.jsonl").write_bytes(first)
    begin = Begin(scope="hosted/simple-12/0")
    begun = to_json(msgspec.structs.replace(begin, line_key=line_key_of(begin)))
    (tape / "exchanges.jsonl").write_bytes(  # the second episode was begun, its first line is torn
        whole + begun.strip() + b'\n{"count":0,"key":"d9c2'
    )
    resumed = Run(path, folder, cassette=Cassette(tape, "record"))
    assert len(list(resumed.episodes())) == 1
    replayed = Run(path, tmp_path / "again", cassette=Cassette(tape, "replay"))
    list(replayed.episodes())
    assert files_below(tmp_path / "again") == files_below(folder)
    spent = [one for record in replayed.records for one in record.spent()]
    assert {one.role for one in spent} == {"planner", "embedder"}
    planner = [one for one in spent if one.role == "planner"]
    assert sum(one.cost for one in planner) > 0


@pytest.mark.model
def test_run_with_local_models_replays_the_same_bytes_too(experiment, tmp_path):
    path = experiment(only=["simple-12"])
    path.write_text(path.read_text().partition("[models]")[0])
    names = ("record", "replay")
    for mode in names:
        run = Run(path, tmp_path / mode, cassette=Cassette(tmp_path / "tape", mode))
        assert all(part.answers for record in run.episodes() for part in record.subtasks)
    assert files_below(tmp_path / "record") == files_below(tmp_path / "replay")


@pytest.mark.model
def test_replay_of_another_experiment_ends_the_run_and_shows_the_difference(experiment, tmp_path):
    tape = tmp_path / "tape"
    list(Run(experiment(), tmp_path / "run", cassette=Cassette(tape, "record")).episodes())
    other = tmp_path / "tasks.jsonl"
    other.write_text(TASKS.read_text().replace("fridge", "freezer"))
    path = experiment()
    path.write_text(path.read_text().replace(str(TASKS), str(other)))
    said = karma("eval", path, "--out", tmp_path / "other", "--cassette", tape, code=1)
    assert "the nearest differs:" in said
    assert "freezer" in said
    assert not (tmp_path / "other" / "episodes.jsonl").exists()


@pytest.mark.model
def test_run_command_takes_a_hosted_planner_and_prints_its_bill(server, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shared = (
        "run", "Open the fridge.", "--planner", "openai", "--model", "nano-chat",
        "--set", "models.constraint=free", "--profile", "compact", "--cassette", "tape",
    )  # fmt: skip
    recorded = karma(*shared, "--base-url", server, "--cassette-mode", "record",
                     "--maps", "maps-1", "--json", "1.json")  # fmt: skip
    assert re.search(r"planner nano-chat: \d+ requests \(0 failed\), \d+ \+ \d+ tokens", recorded)
    karma(*shared, "--base-url", "http://127.0.0.1:9/v1", "--maps", "maps-2", "--json", "2.json")
    one, two = (json.loads(Path(name).read_text()) for name in ("1.json", "2.json"))
    assert one.pop("run") != two.pop("run")
    assert one == two
    assert one["hosted"][0]["requests"] >= 1


def test_documents_name_every_field_of_an_endpoint():
    text = (ROOT / "docs" / "plugins" / "hosted.md").read_text()
    fields = [field.name for field in msgspec.structs.fields(Endpoint)]
    assert [name for name in fields if not re.search(rf"(`|^){name}(`| = )", text, re.M)] == []
