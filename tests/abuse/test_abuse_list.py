"""Single findings of the list of what gave way once, that no class of attacks draws."""

import json

from typer.testing import CliRunner

from karma.cli import app

TASK = {"id": "a", "kind": "simple", "scene": "kitchen_1",
        "subtasks": [{"instruction": "x", "goals": ["OPEN(Fridge)"]}]}  # fmt: skip


def karma(*words):
    """The exit code and all that was printed; an exception that is no exit fails the test."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def experiment(folder, *, tasks=(TASK,), more=""):
    (folder / "tasks.jsonl").write_text("".join(json.dumps(task) + "\n" for task in tasks))
    path = folder / "x.toml"
    path.write_text(
        f'name = "[/red]"\ntasks = "tasks.jsonl"\n{more}\n[[rows]]\nname = "[/red]"\n'
        'method = "expert"\n'
    )
    return path


def test_names_in_markup_are_printed_by_every_command_that_shows_a_run(tmp_path):
    task = {**TASK, "id": "[/red]", "subtasks": [{**TASK["subtasks"][0], "instruction": "[/red]"}]}
    path = experiment(tmp_path, tasks=(task,))
    for words in (("eval", path, "--out", tmp_path / "run", "--tasks"), ("table", tmp_path / "run"),
                  ("tasks", "check", tmp_path / "tasks.jsonl"),
                  ("compare", tmp_path / "run", tmp_path / "run"),
                  ("export", tmp_path / "run")):  # fmt: skip
        assert karma(*words)[0] == 0, words
    assert "[/red]" in karma("table", tmp_path / "run")[1]
