"""The `karma` command: what it prints and writes, and how it says that something is wrong."""

import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from support.needs import need_models
from support.paths import ROOT
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma import registry
from karma.cli import app
from karma.cli.commands import all_commands, imported
from karma.world.core import scene as scenes

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    return str(export_tiny(tmp_path_factory.mktemp("planner") / "tiny.gguf"))


def karma(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result.output


def refused(*arguments):
    """The error of a command that fails as it should: one message, no traceback."""
    text = karma(*arguments, code=1)
    assert "error:" in text
    assert "Traceback" not in text
    return text


# ----------------------------------------------------------------- world


def test_world_list_names_every_scene(tmp_path):
    text = karma("world", "list", "--json", tmp_path / "list.json")
    rows = json.loads((tmp_path / "list.json").read_text())
    assert {row["scene"] for row in rows} == {path.stem for path in scenes.SCENES.glob("*.json")}
    assert all(row["scene"] in text and row["objects"] > 10 for row in rows)


def test_world_show_draws_a_picture(tmp_path):
    path = tmp_path / "new" / "picture.png"
    assert "kitchen_1" in karma("world", "show", "kitchen_1", "--out", path)
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert min(width, height) > 300
    assert len(data) > 20_000


def test_world_show_of_an_unknown_scene_says_which_command_lists_them():
    text = refused("world", "show", "attic")
    assert "no scene named 'attic'" in text
    assert "To fix: karma world list" in text
    assert not list(Path().iterdir())


# ----------------------------------------------------------------- models


def test_models_list_shows_role_size_and_licence(tmp_path):
    text = karma("models", "list", "--json", tmp_path / "models.json")
    assert "minilm" in text
    assert "embedder" in text
    assert "minilm" in [row["name"] for row in json.loads((tmp_path / "models.json").read_text())]


def test_models_verify_checks_every_model():
    assert "✓ minilm: 9 files as they must be" in karma("models", "verify")


# ----------------------------------------------------------------- run


def test_run_with_any_gguf_says_what_it_does_and_leaves_a_run(planner, tmp_path):
    report = tmp_path / "report.json"
    words = ["run", "Open the fridge", "--planner", planner, "--profile", "compact"]
    result = CliRunner().invoke(app, [*words, "--json", str(report)])
    assert result.exit_code in (0, 3, 4), result.output  # random weights may fail, but not break
    assert "1. Open the fridge" in result.output
    assert "I will" in result.output or "not " in result.output
    assert "run: runs/talks/kitchen_1-1" in result.output
    found = json.loads(report.read_text())
    assert found["finished"] == (result.exit_code == 0)
    assert [part["instruction"] for part in found["instructions"]] == ["Open the fridge"]
    assert Path("runs/maps/kitchen_1.json").exists()


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--planner", "karma-nanno"], "no model named 'karma-nanno'"),
        (["--planner", "none.gguf"], "none.gguf"),
        (["--profile", "terse"], "no prompt profile named 'terse'"),
        (["--scene", "attic"], "To fix: karma world list"),
        (["--set", "options.policy=fifo[0]"], "fifo[0]"),
        (["--set", "options.policy=fifoo[3]"], "Did you mean 'fifo'"),
        (["--set", "recall_k=3"], "To fix: --set options.recall_k=5"),
    ],
)
def test_run_with_a_wrong_option_says_so(planner, options, named):
    arguments = ["run", "go", "--planner", planner, "--profile", "compact", *options]
    assert named in refused(*arguments)


@pytest.mark.model
def test_run_with_the_shipped_planner_puts_the_apple_into_the_fridge(tmp_path):
    need_models("karma-nano")
    report = tmp_path / "report.json"
    karma("run", "Put the apple in the fridge.", "--json", report)
    (part,) = json.loads(report.read_text())["instructions"]
    assert part["calls"][-1]["ok"]
    assert any(call["text"].startswith("PutObject") for call in part["calls"])


# ----------------------------------------------------------------- eval


@pytest.fixture
def experiment(planner, tmp_path):
    path = tmp_path / "x.toml"
    path.write_text(
        f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-12"]\n'
        f'[[rows]]\nname = "expert"\nmethod = "expert"\n[models]\nplanner = "{planner}"\n'
    )
    return path


def test_eval_prints_the_table_and_writes_figures(experiment, tmp_path):
    text = karma("eval", experiment, "--json", tmp_path / "figures.json")
    assert "1/1" in text
    assert "records: runs/x/episodes.jsonl" in text
    figures = json.loads((tmp_path / "figures.json").read_text())
    rates = [(one["row"], one["kind"], one["values"]["success"]["value"]) for one in figures]
    assert rates == [("expert", "simple", 1.0), ("expert", "all", 1.0)]
    assert all(line["values"].pop("seconds")["value"] > 0 for line in figures)
    kept = json.loads(Path("runs/x/results.json").read_text())
    assert kept == figures
    again = karma("eval", experiment, "--json", tmp_path / "again.json")
    assert "1/1" in again
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "figures.json").read_bytes()


def test_eval_in_another_run_s_folder_names_the_way_out(experiment):
    karma("eval", experiment)
    experiment.write_text(experiment.read_text().replace("simple-12", "simple-04"))
    text = refused("eval", experiment)
    assert f"karma eval {experiment} --fresh" in text
    assert "1/1" in karma("eval", experiment, "--fresh")


def test_error_with_brackets_is_printed_as_it_is(tmp_path):
    assert "[bold]x[/nothing].toml: no such file" in refused("eval", "[bold]x[/nothing].toml")


@pytest.mark.model
def test_shipped_experiments_are_read_by_the_shipped_planner(monkeypatch, tmp_path):
    need_models("karma-nano")
    from karma.bench.engine.run import Run

    monkeypatch.chdir(ROOT)
    for name in ("alfred_l", "demo"):
        run = Run(Path("eval") / f"{name}.toml", tmp_path / name)
        assert run.total == len(run.experiment.rows) * len(run.tasks)


def test_run_of_no_words_is_refused_with_an_example():
    assert 'To fix: karma run "wash the tomato"' in refused("run", "  ")


# ----------------------------------------------------------------- help


SPECS = {one.path: one for one in all_commands()}


@pytest.mark.parametrize("name", sorted(SPECS))
def test_command_says_in_one_line_what_it_does_and_what_each_option_is(name):
    command = imported(SPECS[name])
    for line in (SPECS[name].summary, command.get_short_help_str(limit=200)):
        assert re.fullmatch(r"[A-Z].*\.", line), line
        assert len(line) <= 92  # what fits beside the names in 110 columns
    unsaid = [one.name for one in command.params if one.name != "help" and not one.help]
    assert unsaid == []


def test_help_leads_with_the_agent_and_groups_the_rest():
    text = karma("--help")
    heads = ["The agent at work", "What runs show", "What runs are made of", "This machine"]
    places = [text.index(head) for head in heads]
    assert places == sorted(places)
    assert text.index(" run ") < text.index(" eval ") < places[1]
    assert "Begin with: karma run" in text


def test_help_imports_no_module_of_a_command():
    program = """
import sys
from karma import registry
from karma.cli import app
try:
    app(["--help"])
finally:
    print(*(name for name in sys.modules if name.startswith("karma.")), file=sys.stderr)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True
    )
    assert "The agent at work" in done.stdout
    loaded = done.stderr.split()
    assert "karma.registry" in loaded
    assert {"karma.bench", "karma.agent", "karma.world", "karma.models"}.isdisjoint(loaded)


def test_command_of_a_missing_plug_in_names_the_extra(monkeypatch):
    monkeypatch.setattr(registry, "names", lambda role: [])
    assert "pip install 'karma-offline[airgap]'" in karma("bundle", "build", code=2)
    assert "pip install 'karma-offline[thor_tools]'" in karma("world", "import", "x", code=2)
    assert "bundle" not in karma("--help")


def test_misspelt_command_is_answered_with_the_one_that_was_meant():
    assert "'eval'" in karma("evla", code=2)
