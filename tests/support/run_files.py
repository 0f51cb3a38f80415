"""Small experiments in folders: written, done, killed, and held against each other."""

import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import textwrap
from pathlib import Path

from typer.testing import CliRunner

from karma.cli import app
from karma.journal.folder import TIMINGS
from support.paths import ROOT

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
ONLY = ["simple-11", "simple-14", "composite-14"]
ROWS = (
    '[[rows]]\nname = "expert"\nmethod = "expert"\n'
    '[[rows]]\nname = "babble (K = 3)"\noptions = { recall_k = 3 }\n'
)


def write_experiment(path, planner, *, rows=ROWS, only=ONLY, more="seeds = [0, 1]"):
    path.write_text(
        f'name = "x"\ntasks = "{TASKS}"\nonly = {list(only)}\n{more}\n{rows}'
        f'[models]\nplanner = "{planner}"\nprofile = "compact"\n'
    )
    return path


def files(folder):
    """All that must be the same in every run: path -> content; timings by their keys only."""
    found = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
    found[TIMINGS] = [
        (line["row"], line["task"], line["seed"], len(line["subtasks"]))
        for line in map(json.loads, found[TIMINGS].splitlines())
    ]
    return found


def copy(folder, to):
    shutil.copytree(folder, to)
    return to


def evaluate(path, folder, workers=1, most_bytes=None, shared=None):
    """Do as `karma eval` does, on a disk that has room for no larger files.

    `shared` is where the reference data lies; the server that forks has the environment of its
    own start.
    """
    if shared is not None:
        os.environ["KARMA_SHARED"] = shared
    signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    if most_bytes is not None:
        sys.dont_write_bytecode = True  # half a .pyc would end whoever imports it next
        with Path(os.devnull).open("w") as nowhere:  # what it prints may be in a file too
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))
    app(["eval", str(path), "--out", str(folder), "--workers", str(workers)])


def started(path, folder, **how):
    """`karma eval` in a process of its own, which finds the libraries imported."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        ["karma.cli", "karma.bench.engine.run", "llama_cpp", "karma.models.embed.minilm"]
    )
    how["shared"] = os.environ.get("KARMA_SHARED")
    process = context.Process(target=evaluate, args=(path, folder), kwargs=how)
    process.start()
    return process


def karma(*words, code=0):
    """Do a command in this process; returns what it printed, on a wide terminal."""
    done = CliRunner().invoke(app, list(map(str, words)), env={"COLUMNS": "200"})
    assert done.exit_code == code, done.output
    return done.output


def plant_plugin(place, name, code, group, point):
    """Write a module as an installed package with one entry point, `point` of `karma.GROUP`."""
    info = place / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (place / f"{name}.py").write_text(textwrap.dedent(code))
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[karma.{group}]\n{point}\n")
    return place


def lines_in(path):
    return path.read_bytes().count(b"\n") if path.exists() else 0
