"""`karma doctor`: each condition with its fix, and an exit code that can be relied on."""

import json

import pytest
from typer.testing import CliRunner

from karma.cli import app
from karma.cli.conditions import examine
from karma.offline import guard as offline

SET = {**offline.SWITCHES, **offline.DEFAULTS, offline.OFFLINE: "1"}


@pytest.fixture(autouse=True)
def few_models(clean_models, monkeypatch):
    monkeypatch.setenv("KARMA_MODELS", str(clean_models))


def found(environment, name):
    (one,) = [one for one in examine(environment) if one.name == name]
    return one


def test_switch_that_is_not_set_is_a_problem_with_its_fix():
    told = {one.name: one for one in examine(offline.DEFAULTS)}
    for name in (*offline.SWITCHES, offline.OFFLINE):
        assert (told[name].status, told[name].found) == ("problem", "not set")
        assert f"export {name}=" in told[name].fix


def test_switch_that_says_otherwise_is_a_problem():
    assert found({**SET, "HF_HUB_OFFLINE": "0"}, "HF_HUB_OFFLINE").status == "problem"
    assert found({**SET, "MPLBACKEND": "svg"}, "MPLBACKEND").status == "ok"


def test_plugins_that_other_packages_registered_are_named(tmp_path, monkeypatch):
    assert found(SET, "plug-ins of others").status == "ok"
    info = tmp_path / "strange_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strange-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[karma.policies]\nodd = no.such.module:Odd\n")
    monkeypatch.syspath_prepend(tmp_path)
    one = found(SET, "plug-ins of others")
    assert (one.status, one.found) == ("note", "strange-package: karma.policies/odd")
    assert "uninstall" in one.fix


def test_missing_model_is_a_problem(tmp_path, monkeypatch):
    (tmp_path / "manifest.toml").write_text("models = []\n")
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path))
    assert any(one.status == "problem" for one in examine(SET))
    assert found(SET, "models").status == "problem"


@pytest.mark.model
def test_command_lists_all_and_writes_figures(tmp_path):
    number = len({**offline.SWITCHES, **offline.DEFAULTS})
    given = ["doctor", "--json", str(tmp_path / "x.json")]
    done = CliRunner().invoke(app, given, env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.stdout
    said = json.loads((tmp_path / "x.json").read_text())
    assert said["ok"] is True
    names = {one["name"] for one in said["findings"]}
    assert {"guard", "packages", "model karma-nano"} <= names
    lines = [one for one in done.output.splitlines() if "models that may be brought: " in one]
    assert ["karma models show NAME" in line for line in lines] == [True]
    assert f"{number} of {number} are set" in done.output
    assert "karma doctor thor" in done.output


def test_command_with_a_spoilt_model_exits_with_one(tmp_path, monkeypatch):
    (tmp_path / "manifest.toml").write_text("models = []\n")
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path))
    done = CliRunner().invoke(app, ["doctor"])
    assert done.exit_code == 1
    assert "something is missing" in done.stdout
