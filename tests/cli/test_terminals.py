"""What is printed fits the terminal that is there, and errors have a length that can be read."""

import json
import os
import subprocess
import sys

from typer.testing import CliRunner

from karma.cli import app

ASCII = {
    "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "PYTHONIOENCODING": "",
}  # fmt: skip


def test_terminal_without_unicode_gets_what_it_has(tmp_path):
    text = ascii("fridge → Fridge – 苹果 …")
    program = f"from karma.cli.shared import console; console.print({text})"
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **ASCII}, capture_output=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, b"fridge > Fridge - ?? .\n"), done.stderr


def test_error_that_quotes_a_megabyte_is_cut(tmp_path):
    task = {"id": "a", "kind": "simple", "scene": "kitchen_1",
            "subtasks": [{"instruction": "x", "goals": ["(" * 1_000_000]}]}  # fmt: skip
    path = tmp_path / "long.jsonl"
    path.write_text(json.dumps(task) + "\n")
    done = CliRunner().invoke(app, ["tasks", "check", str(path)])
    assert done.exit_code == 1
    assert "long.jsonl: line 1" in done.stderr
    assert len(done.stderr) < 4000
