"""The wheel, installed where no checkout is: it runs from any folder, with what it carries.

Nothing is downloaded: the environment is new, and takes the libraries of the present one, which it
finds behind its own. Not covered: that the libraries can be installed, which is what the locks are.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from support.paths import ROOT

SOURCES = ("karma", "models", "eval", "pyproject.toml", "setup.py", "README.md", "LICENSE")


def pip(*arguments):
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    subprocess.run(command, check=True, capture_output=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of a copy with a lab's own weights and a folder of results in it."""
    copy, made = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("dist")
    ignored = shutil.ignore_patterns("__pycache__", "weights", "local.toml")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=ignored, copy_function=shutil.copyfile)
        else:
            shutil.copyfile(ROOT / name, copy / name)
    (copy / "models" / "weights" / "ours").mkdir(parents=True)
    (copy / "models" / "weights" / "ours" / "secret.gguf").write_bytes(b"GGUF")
    (copy / "models" / "local.toml").write_text("models = []")
    pip("wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(made), str(copy))
    (path,) = made.glob("*.whl")
    return path


class Installed:
    """A new environment with the wheel in it, used from an empty folder."""

    def __init__(self, wheel: Path, folder: Path) -> None:
        venv.create(folder / "env", with_pip=False)
        self.python = folder / "env" / "bin" / "python"
        pip("--python", str(self.python), "install", "--no-deps", "--no-index", str(wheel))
        (self.packages,) = (folder / "env").glob("lib/python*/site-packages")
        behind = sysconfig.get_path("purelib")  # a line of a .pth does not run that folder's own
        (self.packages / "libraries.pth").write_text(f"{behind}\n")
        self.empty = folder / "empty"
        self.empty.mkdir()

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        gone = ("KARMA_", "PYTHONPATH", "PYTEST_")
        kept = {key: value for key, value in os.environ.items() if not key.startswith(gone)}
        command = [self.python.with_name(arguments[0]), *arguments[1:]]
        return subprocess.run(
            command, cwd=self.empty, env={**kept, "HOME": str(self.empty), "COLUMNS": "120"},
            capture_output=True, text=True, check=False,
        )  # fmt: skip


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    return Installed(wheel, tmp_path_factory.mktemp("fresh"))


def test_wheel_carries_the_data_and_nothing_of_the_lab(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    manifest = tomllib.loads((ROOT / "models" / "manifest.toml").read_text(encoding="utf-8"))
    ours = [m for m in manifest["models"] if m["name"].startswith("karma-nano")]
    expected = {f"models/{file['path']}" for model in ours for file in model["files"]}
    expected |= {"models/manifest.toml", "models/cards/karma-nano.md", "eval/demo.toml"}
    expected |= {f"eval/paper/{path.name}" for path in (ROOT / "eval" / "paper").iterdir()}
    carried = {n.removeprefix("karma/shipped/") for n in names if n.startswith("karma/shipped/")}
    assert expected - carried == set()
    assert not [n for n in carried if "weights/" in n or "local.toml" in n or "results/" in n]
    assert not [n for n in carried if n.endswith((".py", "start.gguf"))]
    assert {"karma/world/scenes/kitchen_1.json", "karma/py.typed"} <= names
    assert not [n for n in names if n.startswith(("models/", "eval/", "tests/"))]


def test_installed_karma_is_the_wheel_s_and_its_models_are_whole(installed):
    where = installed.run("python", "-c", "import karma; print(karma.__file__)")
    assert Path(where.stdout.strip()).is_relative_to(installed.packages)
    done = installed.run("karma", "models", "verify", "karma-nano", "karma-nano-vlm", "minilm")
    assert done.returncode == 0, done.stdout + done.stderr


def test_installed_karma_runs_from_an_empty_folder(installed):
    done = installed.run("karma", "run", "put the apple in the fridge", "--json", "out.json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "run: runs/talks/kitchen_1-1" in done.stdout  # whatever the planner makes of it
    assert (installed.empty / "runs" / "maps").is_dir()


def test_installed_karma_finds_an_experiment_by_name_and_by_path(installed):
    few = ("--out", "out", "--limit", "1", "--row", "without memory")
    for given in ("demo", "eval/demo.toml"):  # the second finds all done
        done = installed.run("karma", "eval", given, *few)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "without memory" in done.stdout


def test_installed_karma_brings_fixtures_for_the_tests_of_others(installed):
    """The example of docs/testing.md."""
    example = (ROOT / "docs" / "testing.md").read_text(encoding="utf-8")
    code = example.partition("```python\n")[2].partition("```")[0]
    (installed.empty / "test_ours.py").write_text(code, encoding="utf-8")
    plain = ("-q", "-p", "no:cacheprovider", "--assert=plain")  # else all of karma is compiled anew
    done = installed.run("python", "-m", "pytest", *plain, "test_ours.py")
    assert "2 passed" in done.stdout, done.stdout + done.stderr


def test_installed_karma_s_advice_holds_where_no_checkout_is(installed):
    unknown = installed.run("karma", "eval", "demmo")
    assert (unknown.returncode, "Did you mean 'demo'" in unknown.stderr) == (1, True)
    assert "To fix: karma eval demo" in unknown.stderr
    weights = installed.packages / "karma" / "shipped" / "models" / "nano" / "planner.gguf"
    whole = weights.read_bytes()
    weights.write_bytes(b"GGUF")
    try:
        damaged = installed.run("karma", "run", "wash the mug")
    finally:
        weights.write_bytes(whole)
    assert damaged.returncode == 1
    assert "To fix: pip install --force-reinstall --no-deps karma-offline==" in damaged.stderr
