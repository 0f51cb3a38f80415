"""`karma world` with wrong input: one clear line, what helps, and no traceback."""

import pytest
from typer.testing import CliRunner

from karma.cli import app

WRONG = {
    "torn.jsonl.gz": b"\x1f\x8b\x08\x00torn",
    "empty.jsonl": b"",
    "nothing.json": b"[]",
    "cut.json": b'{"a":',
    "other.json": b"{}",
    "null.json": b"null",
    "recording.jsonl": b'{"action": {"action": "Initialize"}, "metadata": {}}',
    "bytes.json": b"\xff\xfe\x00",
}
COMMANDS = ("import", "import-trials", "replay", "replay-events", "show")


def said(*arguments):
    result = CliRunner().invoke(app, ["world", *arguments])
    assert result.exit_code == 1
    assert isinstance(result.exception, SystemExit)
    return result.output


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", [*WRONG, "missing.json"])
def test_wrong_file_is_named_and_something_helps(tmp_path, monkeypatch, command, name):
    monkeypatch.chdir(tmp_path)
    if name in WRONG:
        (tmp_path / name).write_bytes(WRONG[name])
    text = said(command, name)
    assert text.startswith(f"error: {name}: ")
    assert "To fix: " in text


@pytest.mark.parametrize("name", ["attic", "a\0b", "x" * 400, "attic.json", "no/where.json"])
def test_scene_of_any_name_that_is_not_there_is_refused(name):
    assert "karma world list" in said("show", name)


def test_folder_that_is_a_file_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    text = said("show", "kitchen_1", "--out", str(tmp_path / "file/a.png"))
    assert "cannot write" in text
    assert "To fix: " in text
