"""A person's folder may hold a `random.py`: no command imports it, whatever process it starts."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.paths import ROOT

HOSTILE = (
    "random",
    "json",
    "typing",
    "queue",
    "ctypes",
    "sitecustomize",
    "usercustomize",
    "socket",
)
KARMA = Path(sys.executable).with_name("karma")
EVAL = f"""name = "two"
tasks = "{ROOT}/eval/alfred_l/tasks.jsonl"
only = ["simple-03", "simple-09"]
[[rows]]
name = "blind"
method = "expert"
"""


@pytest.fixture
def folder(tmp_path):
    """A folder in which each module says that it was imported, and then is none."""
    for name in HOSTILE:
        tells = f"open({str(tmp_path / 'WITNESS')!r}, 'a').write({name!r} + chr(10))"
        text = f"{tells}\nraise SystemExit(7)\n"
        (tmp_path / f"{name}.py").write_text(text)
    shutil.copy(ROOT / "models/nano/planner.gguf", tmp_path / "mine.gguf")
    (tmp_path / "two.toml").write_text(EVAL)
    return tmp_path


def run_in(folder, *words, code=0, **given):
    done = subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        **given,
    )
    assert not (folder / "WITNESS").exists(), (folder / "WITNESS").read_text()
    assert code is None or done.returncode == code, done.stderr + done.stdout


def test_workers_import_nothing_of_the_folder(folder):
    run_in(folder, KARMA, "eval", "two.toml", "--workers", "2", "--out", folder / "out")


def test_trial_of_a_gguf_imports_nothing_of_the_folder(folder):
    words = ("run", "open the fridge", "--planner", "mine.gguf", "--out", folder / "out")
    run_in(folder, KARMA, *words, "--scene", "kitchen_1", code=None)


PYTHON = [sys.executable, "-P", "-c"]


@pytest.mark.parametrize(
    "code",
    [
        "from karma.infer.checks.template import try_template; try_template('mine', '{{ 1 }}')",
        "from karma.infer.llama.opening import try_in_own_process\n"
        "from pathlib import Path; try_in_own_process(Path('mine.gguf'))",
        "from karma.errors import ModelError\n"
        "from karma.infer.llama import picture_chat as chat\n"
        "from karma.infer.manifest.picture_pair import PicturePair\n"
        "from pathlib import Path\n"
        "pair = PicturePair(name='p', model=Path('mine.gguf'), projector=Path('mine.gguf'))\n"
        "try:\n    chat._try_in_own_process(pair)\nexcept ModelError as error:\n"
        "    assert 'cannot look at a picture' in str(error)",
    ],
)
def test_checks_of_files_import_nothing_of_the_folder(folder, code):
    run_in(folder, *PYTHON, code)


def test_player_imports_nothing_of_the_folder(folder):
    code = "import shlex, subprocess\nfrom karma.world.player.launch import command\n"
    code += "subprocess.run([*shlex.split(command()), '--help'], check=True)"
    run_in(folder, *PYTHON, code)


def test_guard_of_the_simulator_imports_nothing_of_the_folder(folder):
    code = "import subprocess, sys\nfrom karma.world.thor import guard\n"
    code += "subprocess.run([sys.executable, '-I', '-S', guard.__file__, 'true'])"
    run_in(folder, *PYTHON, code)


def test_command_line_as_a_module_hands_its_folder_to_no_worker(folder):
    words = ("-P", "-m", "karma", "eval", "two.toml", "--workers", "2", "--out", folder / "out")
    run_in(folder, sys.executable, *words)


def test_processes_that_are_started_are_offline_before_they_import_more(folder):
    from karma.offline import own_python

    refused = "import socket\ntry:\n    socket.create_connection(('192.0.2.1', 80), 1)\n"
    refused += "except Exception as error:\n    print(type(error).__name__)"
    done = subprocess.run(
        own_python(refused), cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.stdout == "NetworkRefused\n", done.stderr
    assert not (folder / "WITNESS").exists()
