"""A bundle installed: without a network, killed and gone on with, moved, refused where it may harm.

The bundle is real but for its size: our own wheel, the shipped models, and in the place of the big
packages wheels without code beside one .pth file, which leads to those of the running environment.
"""

import ensurepip
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from importlib.metadata import requires, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from support.bundles import wheel_bytes
from support.needs import need_models, need_namespace
from support.paths import ROOT
from typer.testing import CliRunner

from karma.cli import app
from karma.journal.provenance import parts_of_planner
from karma.models.manifest import find_model
from karma.plugins.airgap import install as installing
from karma.plugins.airgap.install import BundleError, install

MODELS = ("karma-nano", "minilm")


@pytest.fixture(scope="module")
def cut_off():
    return need_namespace()


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """A bundle with our wheel and our models."""
    need_models(*MODELS)
    folder = tmp_path_factory.mktemp("bundle")
    wheels = folder / "wheels"
    wheels.mkdir()
    for need in map(Requirement, requires("karma-offline")):
        if need.marker is None or need.marker.evaluate({"extra": ""}):
            name = canonicalize_name(need.name).replace("-", "_")
            data = wheel_bytes(name, version(need.name), module=False)
            (wheels / f"{name}-{version(need.name)}-py3-none-any.whl").write_bytes(data)
    way = {"way.pth": sysconfig.get_path("purelib") + "\n"}
    (wheels / "way-1.0-py3-none-any.whl").write_bytes(wheel_bytes("way", extra=way.items()))
    for pip in Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl"):
        shutil.copy(pip, wheels)
    # the environment may hold a package of real weights, without the `llm` that it asks for
    (wheels / "llm-1.0-py3-none-any.whl").write_bytes(wheel_bytes("llm", module=False))
    (folder / "lock").write_text("llm==1.0\nway==1.0\n")
    shutil.copy(installing.__file__, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KARMA_CACHE", str(folder))  # llama-cpp-python's real wheel lies in the other,
        patch.setattr("karma.plugins.airgap.build.BUILT", "no note")  # or where set-up noted
        patch.setenv("PIP_CONFIG_FILE", os.devnull)  # may name others, as the next
        patch.delenv("PIP_FIND_LINKS", raising=False)
        words = ["--out", folder / "karma.tar", "--wheels", wheels, "--lock", folder / "lock"]
        words += [word for name in MODELS for word in ("--models", name)]
        words = ["bundle", "build", *words, "--json", folder / "built.json"]
        done = CliRunner().invoke(app, [*map(str, words)])
        assert done.exit_code == 0, done.output
    return folder / "karma.tar"


def command(bundle, into, *more):
    installer = bundle.with_name("install.py")
    return [sys.executable, "-I", str(installer), str(bundle), "--into", str(into), *more]


def run(*words, cwd):
    environment = {"PATH": os.environ["PATH"], "HOME": str(cwd), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*map(str, words)], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.model
def test_bundle_installs_and_runs_the_demo_where_there_is_no_interface(bundle, cut_off, tmp_path):
    moved = tmp_path / "carried"
    moved.mkdir()
    shutil.copy(bundle, moved / "karma.tar")
    script = run("tar", "-xf", "karma.tar", "install.py", cwd=moved)
    assert script == ""
    place = moved / "there"
    said = run(
        *cut_off, sys.executable, "-I", "install.py", "karma.tar", "--into", place, cwd=moved
    )
    assert "$ karma models verify karma-nano minilm" in said
    assert "$ karma run Open the fridge." in said
    run(*cut_off, place / "karma", "eval", "eval/demo.toml", "--limit", "1", cwd=place)
    lines = (place / "runs/demo/episodes.jsonl").read_text().splitlines()
    assert len(lines) == 2
    assert all(json.loads(line)["error"] == "" for line in lines)
    found = json.loads((place / "runs/demo/header.json").read_text())
    weights = parts_of_planner(found["models"]["planner"])[1]
    assert weights == find_model("karma-nano").files[0].sha256
    inside = "import karma; print(karma.__file__)"
    assert str(place) in run(place / "venv/bin/python", "-c", inside, cwd=tmp_path)


@pytest.mark.model
def test_build_writes_what_it_made_as_json(bundle):
    made = json.loads((bundle.parent / "built.json").read_text())
    assert made["path"] == str(bundle)
    assert (made["models"], made["bytes"]) == ([*MODELS], bundle.stat().st_size)


@pytest.mark.model
def test_installation_killed_at_any_step_goes_on(bundle, tmp_path):
    place = tmp_path / "there"
    for step in ("verifying", "unpacking", "making", "Installing", "$"):
        with subprocess.Popen(
            command(bundle, place, "--no-smoke"), stdout=subprocess.PIPE, text=True
        ) as child:
            for line in child.stdout:
                if line.strip().startswith(step):
                    child.send_signal(signal.SIGKILL)
                    break
        assert child.returncode == -signal.SIGKILL, step
        assert not (place / "karma").exists() or step == "$"
    (place / "eval" / "demo.toml").write_text("spoilt")  # which is mended then
    run(*command(bundle, place, "--no-smoke"), cwd=tmp_path)
    assert "Usage: karma" in run(place / "karma", "--help", cwd=tmp_path)
    assert (place / "eval" / "demo.toml").read_bytes() == (ROOT / "eval/demo.toml").read_bytes()

    place.rename(tmp_path / "moved")
    assert "kitchen_1" in run(tmp_path / "moved" / "karma", "world", "list", cwd=tmp_path)


@pytest.mark.model
def test_folder_that_holds_something_else_is_left_alone(bundle, tmp_path):
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(BundleError, match=r"not empty, there is 'thesis\.txt'"):
        install(bundle, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".karma-lock", "thesis.txt"]


@pytest.mark.model
def test_folder_of_another_bundle_is_left_alone(bundle, tmp_path):
    (tmp_path / ".karma-bundle").write_text("0" * 64)
    with pytest.raises(BundleError, match="another bundle"):
        install(bundle, tmp_path)


@pytest.mark.model
def test_second_installation_at_once_is_refused(bundle, tmp_path):
    with (tmp_path / ".karma-lock").open("wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(BundleError, match="another installation"):
            install(bundle, tmp_path)


@pytest.mark.model
def test_flipped_byte_leaves_no_trace_in_the_folder(bundle, tmp_path):
    data = bytearray(bundle.read_bytes())
    place = data.index(b"GGUF") + 2_000_000
    data[place] ^= 1
    (tmp_path / "spoilt.tar").write_bytes(data)
    with pytest.raises(BundleError, match=r"models/nano/planner\.gguf: its SHA-256"):
        install(tmp_path / "spoilt.tar", tmp_path / "there")
    assert not (tmp_path / "there").exists()


@pytest.mark.model
def test_command_line_verifies_and_names_the_wrong_member(bundle, tmp_path):
    done = CliRunner().invoke(app, ["bundle", "verify", str(bundle)])
    assert done.exit_code == 0
    assert "models karma-nano, minilm" in done.stdout
    data = bundle.read_bytes()
    (tmp_path / "cut.tar").write_bytes(data[: len(data) // 2])
    done = CliRunner().invoke(app, ["bundle", "verify", str(tmp_path / "cut.tar")])
    assert done.exit_code == 1
    assert "breaks off" in done.stderr
