"""Nothing needs a network: whole commands run where there is no interface at all."""

import json
import os
import shutil
import subprocess
import sys

import pytest
from support.needs import CUT_OFF, need_models, need_namespace
from support.paths import ROOT

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
INTERFACES = "import socket; print([name for _, name in socket.if_nameindex() if name != 'lo'])"


@pytest.fixture(scope="module")
def cut_off():
    """A function that runs a command in a network namespace of its own, which has no interface."""
    prefix = need_namespace()

    def run(folder, *command, first=()):
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("HF_", "TRANSF"))}
        found = subprocess.run(
            [*prefix, *first, sys.executable, *command],
            cwd=folder, capture_output=True, text=True, check=False, env=environment,
        )  # fmt: skip
        assert found.returncode == 0, found.stdout + found.stderr
        return found.stdout

    return run


def karma(*arguments):
    return ("-c", "from karma.cli import app; app()", *map(str, arguments))


EXPERIMENT = f"""name = "x"
tasks = "{TASKS}"
only = ["simple-12"]
rows = [{{ name = "expert", method = "expert" }}, {{ name = "KARMA" }}]
[models]
planner = "karma-nano"
"""


def traced(folder):
    """What to put before a command whose socket calls shall be kept; () where that is forbidden."""
    words = ("strace", "-f", "-qq", "-e", "trace=network", "-o", str(folder / "trace"))
    if shutil.which("strace") is None:
        return ()
    trial = subprocess.run([*CUT_OFF, *words, "true"], capture_output=True, check=False)
    return words if trial.returncode == 0 else ()


def test_namespace_has_no_interface(cut_off, tmp_path):
    assert cut_off(tmp_path, "-c", INTERFACES).strip() == "[]"


@pytest.mark.model
def test_runs_need_no_interface_and_connect_to_no_other_machine(cut_off, tmp_path):
    """Expert and agent; every socket call as the kernel saw it, those of compiled code too."""
    need_models("karma-nano")
    (tmp_path / "x.toml").write_text(EXPERIMENT)
    first = traced(tmp_path)
    cut_off(tmp_path, *karma("eval", "x.toml", "--json", "figures.json"), first=first)
    figures = json.loads((tmp_path / "figures.json").read_text())
    expert = [line["values"]["success"]["value"] for line in figures if line["row"] == "expert"]
    assert expert == [1.0, 1.0]
    lines = (tmp_path / "runs/x/episodes.jsonl").read_text().splitlines()
    (record,) = [one for one in map(json.loads, lines) if one["row"] == "KARMA"]
    assert record["error"] == ""
    assert all(sub["answers"] for sub in record["subtasks"])
    said = cut_off(tmp_path, *karma("run", "Open the fridge.", "--json", "run.json"))
    assert "1. Open the fridge" in said
    assert json.loads((tmp_path / "run.json").read_text())["finished"]
    if not first:
        pytest.skip("all ran; whom it called needs strace, and leave to trace")
    calls = (tmp_path / "trace").read_text().splitlines()
    reached = [line for line in calls if "sin_addr" in line or "sin6_addr" in line]
    assert [line for line in reached if '"127.' not in line and '"::1"' not in line] == []
