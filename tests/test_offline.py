"""Nothing needs a network: whole commands run where there is no interface at all."""

import json
import os
import shutil
import socket
import subprocess
import sys

import pytest
from support.needs import CUT_OFF, need_models, need_namespace
from support.paths import ROOT
from support.tiny import export_tiny

from karma.agent.goals.files import load_tasks
from karma.bench.engine.episode import run_episode
from karma.bench.rows.expert import ExpertMethod
from karma.world.sim import EmbeddedWorld

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
INTERFACES = "import socket; print([name for _, name in socket.if_nameindex() if name != 'lo'])"


@pytest.fixture(scope="module")
def cut_off():
    """A function that runs a command in a network namespace of its own, which has no interface."""
    prefix = need_namespace()

    def run(folder, *command):
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("HF_", "TRANSF"))}
        found = subprocess.run(
            [*prefix, sys.executable, *command],
            cwd=folder, capture_output=True, text=True, check=False, env=environment,
        )  # fmt: skip
        assert found.returncode == 0, found.stdout + found.stderr
        return found.stdout

    return run


def karma(*arguments):
    return ("-c", "from karma.cli import app; app()", *map(str, arguments))


def experiment(folder, planner, rows):
    path = folder / "x.toml"
    path.write_text(
        f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-12"]\n{rows}'
        f'[models]\nplanner = "{planner}"\n'
    )
    return path


EXPERT = '[[rows]]\nname = "expert"\nmethod = "expert"\n'


def test_namespace_has_no_interface(cut_off, tmp_path):
    assert cut_off(tmp_path, "-c", INTERFACES).strip() == "[]"


def test_expert_runs_without_an_interface(cut_off, tmp_path):
    path = experiment(tmp_path, export_tiny(tmp_path / "tiny.gguf"), EXPERT)
    cut_off(tmp_path, *karma("eval", path, "--json", "figures.json"))
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert [line["values"]["success"]["value"] for line in figures] == [1.0, 1.0]


def test_agent_with_any_gguf_runs_without_an_interface(cut_off, tmp_path):
    """Embedder, llama.cpp, both memories: all of it but the shipped weights."""
    row = '[[rows]]\nname = "KARMA"\noptions = { attempts = 1 }\n'
    path = experiment(tmp_path, export_tiny(tmp_path / "tiny.gguf"), row)
    path.write_text(path.read_text() + 'profile = "compact"\n')
    cut_off(tmp_path, *karma("eval", path))
    (line,) = (tmp_path / "runs/x/episodes.jsonl").read_text().splitlines()
    record = json.loads(line)
    assert record["error"] == ""
    assert all(sub["answers"] for sub in record["subtasks"])


@pytest.mark.model
def test_shipped_planner_runs_without_an_interface(cut_off, tmp_path):
    need_models("karma-nano")
    path = experiment(tmp_path, "karma-nano", '[[rows]]\nname = "KARMA"\n')
    cut_off(tmp_path, *karma("eval", path, "--json", "figures.json"))
    said = cut_off(tmp_path, *karma("run", "Open the fridge.", "--json", "run.json"))
    assert "1. Open the fridge" in said
    assert json.loads((tmp_path / "run.json").read_text())["finished"]


def test_expert_opens_no_socket(monkeypatch, tmp_path):
    opened = []
    original = socket.socket.__init__

    def noting(self, *arguments, **options):
        opened.append(arguments)
        original(self, *arguments, **options)

    monkeypatch.setattr(socket.socket, "__init__", noting)
    (task,) = [task for task in load_tasks(TASKS) if task.id == "simple-12"]
    record = run_episode(
        ExpertMethod(), EmbeddedWorld(), task, row="expert", seed=0, folder=tmp_path
    )
    assert record.success
    assert opened == []


@pytest.mark.model
def test_traced_run_connects_to_no_other_machine(cut_off, tmp_path):
    """Every socket call of a small run, as the kernel saw it; compiled code included."""
    if shutil.which("strace") is None:
        pytest.skip("needs strace")
    path = experiment(tmp_path, "karma-nano", '[[rows]]\nname = "KARMA"\n')
    done = subprocess.run(
        [*CUT_OFF, "strace", "-f", "-qq", "-e", "trace=network", "-o", str(tmp_path / "trace"),
         sys.executable, *karma("eval", path)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "PTRACE" in done.stderr or "ptrace" in done.stderr:
        pytest.skip(f"tracing is not permitted here: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, done.stderr
    calls = (tmp_path / "trace").read_text().splitlines()
    reached = [line for line in calls if "sin_addr" in line or "sin6_addr" in line]
    assert [line for line in reached if '"127.' not in line and '"::1"' not in line] == []
