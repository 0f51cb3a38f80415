"""The page on plug-ins runs as it stands: its files are written down, installed and used."""

import os
import re
import subprocess
import sys
import tomllib

import pytest
from support.needs import need_models
from support.paths import ROOT

PAGE = ROOT / "docs" / "plugins" / "README.md"
RUN = "import sys; from karma.cli import app; app(sys.argv[1:])"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of the page, and the package as an installer would describe it."""
    place = tmp_path_factory.mktemp("plugins")
    blocks = re.findall(
        r"\*\*(\S+)\*\*\n\n```\w+\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    for name, text in blocks:
        (place / name).write_text(text, encoding="utf-8")
    project = tomllib.loads((place / "pyproject.toml").read_text())["project"]
    info = place / "my_karma-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-karma\nVersion: 1.0\n")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    said(place, "make_room.py")
    return place


def said(place, *arguments, code=0):
    """What Python prints there, where the package is installed."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=place, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": f"{place}{os.pathsep}{ROOT}"},
    )  # fmt: skip
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


def test_tasks_in_the_room_measure_something(folder):
    assert "nothing wrong" in said(folder, "-c", RUN, "tasks", "check", "tasks.jsonl")


@pytest.mark.model
def test_experiment_runs_policy_recall_and_method(folder):
    need_models("karma-nano")
    shown = said(folder, "-c", RUN, "eval", "ours.toml", "--out", "run")
    assert "KARMA, last out" in shown and "shrug" in shown
    records = b"".join(path.read_bytes() for path in (folder / "run").rglob("*.jsonl"))
    assert b'"shrug"' in records and b'"KARMA, last out"' in records
