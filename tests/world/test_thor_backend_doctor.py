"""`karma doctor thor` and the search for a build: what is missing is named, with what mends it.

A build here is an empty script with AI2-THOR's names round it: nothing starts it.
"""

import json
import subprocess

import pytest
from support import fake_player
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import KarmaError
from karma.world.thor import builds

pytest.importorskip("ai2thor", reason="needs the package ai2thor")


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A home folder without anything, and an environment without traps."""
    for name in ("KARMA_THOR_BUILD", "CUDA_VISIBLE_DEVICES", "DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def build(home):
    """A whole build in the cache."""
    path = builds.cached("CloudRendering")
    path.parent.mkdir(parents=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    (path.parent / f"{path.name}_Data").mkdir()
    return path


def of(name, **options):
    return next(one for one in builds.examine(**options) if one.name == name)


def mended(finding):
    """Run the command that a finding proposes."""
    subprocess.run(finding.fix, shell=True, check=True)


def test_no_build_names_the_place_the_size_the_source_and_the_command(home):
    with pytest.raises(KarmaError) as caught:
        builds.find(platform="Linux64")
    text = str(caught.value)
    place = home / ".ai2thor" / "releases" / f"thor-Linux64-{builds.COMMIT}"
    for part in (str(place), builds.SOURCE, builds.SIZE, "unzip", "chmod +x", "KARMA_THOR_BUILD"):
        assert part in text


def test_build_in_the_cache_is_found(build):
    found = builds.find()
    assert (found.path, found.platform, found.origin) == (build, "CloudRendering", "cache")
    assert of("build").status == of("executable bit").status == "ok"
    assert of("_Data folder").status == "ok"


def test_commit_is_the_packages_own():
    from ai2thor.build import COMMIT_ID

    assert builds.COMMIT == COMMIT_ID


def test_build_by_variable_is_found_as_file_folder_and_command(build, monkeypatch):
    for text, words in (
        (str(build), 1),
        (str(build.parent), 1),
        (f"'{build}' -force-device-index 1", 3),
    ):
        monkeypatch.setenv("KARMA_THOR_BUILD", text)
        found = builds.find()
        assert (found.path, len(found.command), found.origin) == (build, words, "$KARMA_THOR_BUILD")


@pytest.mark.parametrize("text", ["", "/no/such/file", "no-such-command --x", "'open quote"])
def test_executable_that_is_none_is_refused(text, home):
    with pytest.raises(KarmaError):
        builds.find(text)


def test_build_without_executable_bit_is_a_problem_that_the_fix_mends(build):
    build.chmod(0o644)
    with pytest.raises(KarmaError, match=r"not executable\n  To fix: chmod"):
        builds.find()
    finding = of("executable bit")
    assert finding.status == "problem"
    mended(finding)
    assert of("executable bit").status == "ok"


def test_command_shows_fixes_writes_json_and_fails_when_something_is_missing(home, tmp_path):
    path = tmp_path / "report.json"
    done = CliRunner().invoke(app, ["doctor", "thor", "--json", str(path)])
    assert done.exit_code == 1
    assert "KARMA_THOR_BUILD" in done.output
    report = json.loads(path.read_text())
    assert report["ok"] is False
    assert report["start"] is None
    build = next(one for one in report["findings"] if one["name"] == "build")
    assert build["status"] == "problem"
    assert "unzip" in build["fix"]
    assert not (home / ".ai2thor").exists()


def test_command_starts_the_player_when_asked_to(home, tmp_path):
    path = tmp_path / "report.json"
    given = ["--executable", fake_player.command(), "--start", "--json", str(path)]
    done = CliRunner().invoke(app, ["doctor", "thor", *given])
    assert done.exit_code == 0, done.output
    report = json.loads(path.read_text())
    assert report["ok"] is True
    assert report["start"]["objects"] == 2
    assert report["start"]["picture"] == [300, 300, 3]
