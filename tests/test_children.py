"""Every process that the stack starts, in a folder whose modules bear the names of Python's own."""

import ast
import os
import re
import sys
from pathlib import Path

import pytest
from support.hostile_folder import KARMA, done_in, write_folder
from support.needs import need_models
from support.paths import ROOT

from karma.offline.children import child_command, run_child

IN_PYTHON = """from pathlib import Path
from karma.bench.engine.run import Run
import llama_cpp, sys
sys.path.insert(0, "")  # as notebooks have it; what this process needs is loaded
if __name__ == "__main__":
    print(len(list(Run(Path("expert.toml"), Path("out")).episodes(2))))
"""


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path)


@pytest.mark.parametrize(
    "words",
    [
        (*KARMA, "eval", "e.toml", "--workers", "2", "--out", "out"),
        (sys.executable, "-m", "karma", "eval", "expert.toml", "--workers", "2", "--out", "out"),
        (sys.executable, "-P", "-c", IN_PYTHON),
    ],
    ids=["workers", "python -m", "in Python"],
)
def test_workers_execute_nothing_of_the_folder(folder, words):
    need_models("karma-nano")
    if "-P" not in words:  # Python itself takes the package from there
        (folder / "karma.py").unlink()
    done_in(folder, *words)


def test_child_has_the_guard_before_it_imports_what_it_calls(tmp_path, monkeypatch):
    (tmp_path / "calls_out.py").write_text(
        "import socket\ndef call():\n    pass\nsocket.create_connection(('192.0.2.1', 80), 1)\n"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", str(ROOT), str(tmp_path)]))
    end = run_child("calls_out:call")
    assert end.code == 1
    assert "only a hosted model may be reached" in end.said


def test_child_takes_modules_from_where_the_variable_names_but_never_from_this_folder(
    folder, monkeypatch
):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", str(folder.parent)]))
    (folder.parent / "theirs.py").write_text("import random, json\ndef call():\n    return 9\n")
    assert run_child("theirs:call").code == 9
    assert not (folder.parent / "marks").exists()


# Where a process may be started, and how it is kept from the folder.
STARTERS = {
    "karma/offline/children.py": "all others call it",
    "karma/world/thor/backend.py": "as children.py, with pipes and a session of its own",
    "karma/world/thor/client.py": "AI2-THOR's client starts the build, which is no Python",
    "karma/plugins/airgap/install.py": "a file of Python's own modules, in a temporary folder",
    "karma/plugins/airgap/build.py": "-I: pip",
    "karma/models/brought.py": "pip, where it is asked to bring a model",
}


def test_processes_are_started_in_one_place_and_the_few_others_are_known():
    found = set()
    for path in sorted((ROOT / "karma").rglob("*.py")):
        text = path.read_text()
        if not re.search("subprocess|multiprocessing|executable", text):
            continue
        for node in ast.walk(ast.parse(text)):
            names = [one.name for one in getattr(node, "names", ())] if _imports(node) else []
            if {"subprocess", "multiprocessing"} & set(names) or _is_executable(node):
                found.add(str(path.relative_to(ROOT)))
    assert found == STARTERS.keys() | {"karma/bench/engine/pool.py"}  # asks who its parent is


def _imports(node):
    return isinstance(node, ast.Import)


def _is_executable(node):
    return (
        isinstance(node, ast.Attribute)
        and node.attr == "executable"
        and (getattr(node.value, "id", "") == "sys")
    )


def test_child_is_a_file_of_ours_with_nothing_of_the_folder_in_its_path():
    words = child_command("json:dumps", "1")
    assert words[1:3] == ["-E", "-P"]
    assert Path(words[3]) == ROOT / "karma" / "offline" / "child.py"
