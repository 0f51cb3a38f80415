"""A folder whose modules bear the names of Python's own, and a command that is run in it."""

import os
import subprocess
import sys

from support.paths import ROOT

NAMES = (
    "random", "json", "typing", "queue", "ctypes", "sitecustomize", "usercustomize", "signal",
    "logging", "socket", "tempfile", "numpy", "llama_cpp", "jinja2", "karma", "tqdm",
)  # fmt: skip
HOSTILE = """import os
with open({mark!r}, "a") as mark:
    mark.write("{name}\\n")
"""
EXPERIMENT = """name = "e"
tasks = "tasks.jsonl"
[[rows]]
name = "KARMA"
"""
EXPERT = f'{EXPERIMENT}method = "expert"\n'
TASK = (
    '{"id": "%s", "kind": "simple", "scene": "kitchen_1", "subtasks": [{"instruction": '
    '"Open the fridge.", "goals": ["OPEN(Fridge)"]}]}\n'
)
KARMA = (sys.executable, "-P", "-m", "karma")


def write_folder(tmp_path):
    """Write the folder of somebody who has such files beside tasks; beside it marks are taken."""
    place = tmp_path / "folder"
    place.mkdir()
    for name in NAMES:
        text = HOSTILE.format(mark=str(tmp_path / "marks"), name=name)
        (place / f"{name}.py").write_text(text)
    (place / "e.toml").write_text(EXPERIMENT)
    (place / "expert.toml").write_text(EXPERT)
    (place / "tasks.jsonl").write_text(TASK % "a" + TASK % "b")
    return place


def done_in(folder, *words, codes=(0,), **environment):
    """Run a command there; return what it said, after a look for marks."""
    done = subprocess.run(
        list(map(str, words)), cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "", **environment},
    )  # fmt: skip
    marks = folder.parent / "marks"
    assert not marks.exists(), f"executed: {marks.read_text()}"
    assert done.returncode in codes, done.stdout + done.stderr
    return done.stdout
