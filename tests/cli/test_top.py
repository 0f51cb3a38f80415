"""What `karma` itself answers: its version, and completion for shells."""

import pytest
from typer.testing import CliRunner

from karma import __version__
from karma.cli import app


def test_version_is_said_without_a_command():
    done = CliRunner().invoke(app, ["--version"])
    assert (done.exit_code, done.output) == (0, f"karma-offline {__version__}\n")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_shown_for_shells_and_nothing_is_installed(shell, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    # Typer asks which shell started the process; a suite may be started by none.
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    done = CliRunner().invoke(app, ["--show-completion", shell], prog_name="karma")
    assert done.exit_code == 0
    assert "_KARMA_COMPLETE" in done.output
    assert list(tmp_path.iterdir()) == []


def test_completion_offers_the_commands():
    words = {"_KARMA_COMPLETE": "complete_bash", "COMP_WORDS": "karma ev", "COMP_CWORD": "1"}
    done = CliRunner().invoke(app, [], prog_name="karma", env=words)
    assert done.output.split() == ["eval"]
