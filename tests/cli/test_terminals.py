"""What is printed fits the terminal that is there, and errors have a length that can be read."""

import io
import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest
from rich.progress import ProgressSample, Task, TaskID
from support.made_records import episode, sub, write_run
from typer.testing import CliRunner

from karma import __version__
from karma.bench.figures.columns import figures
from karma.cli import app, shared
from karma.cli.progress import bar
from karma.cli.shared import SafeConsole
from karma.cli.show import summary_table, task_table
from karma.journal.records import EpisodeTiming, SubTaskTiming
from karma.journal.run_folder import read_run

PLAIN = "from karma.cli import app; app()"

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


# ----------------------------------------------------------------- tables and bars


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with two rows of long names over several tasks."""
    records = []
    for row in ("KARMA with everything that it has (paper)", "memory off, as in the paper"):
        for number in range(9):
            goals = ("OPEN(Fridge): 1", "HOLDON(robot, Mug): 1", "ON(Mug, Plate): 1")
            unmet = goals[: number % 3]
            one = episode(
                sub(*goals[:2], unmet=[goal for goal in goals[:2] if goal in unmet]),
                sub(goals[2], unmet=[]),
                row=row, task=f"task-{number}",
            )  # fmt: skip
            records.append(replace(one, notes=("unresolved 3: there is no such thing",)))
    records = sorted(records, key=lambda one: one.task)
    timings = [
        EpisodeTiming(row=one.row, task=one.task, seed=0, subtasks=parts)
        for one in records
        for parts in [(SubTaskTiming(seconds=12.345),) * 2]
    ]
    return write_run(tmp_path_factory.mktemp("runs") / "run", records, timings=timings)


@pytest.mark.parametrize("columns", ["60", "80", "200"])
@pytest.mark.parametrize("command", ["table", "compare"])
def test_no_figure_is_cut_however_narrow_the_terminal(run, columns, command, tmp_path, monkeypatch):
    monkeypatch.setattr(shared.console, "width", int(columns))
    words = {"table": [str(run), "--out", str(tmp_path)], "compare": []}[command]
    if command == "compare":
        words = [f"{run}:{name}" for name in dict.fromkeys(r.row for r in read_run(run).records)]
    done = CliRunner().invoke(app, [command, *words])
    assert done.exit_code == 0, done.output
    assert "…" not in done.output
    assert re.search(r"0\.33 \[0\.\d\d, 0\.\d\d\]", done.output)  # in one piece, not wrapped
    table = [line for line in done.output.splitlines() if line.startswith(("│", "┃", "┏"))]
    assert max(map(len, table)) <= int(columns)


@pytest.mark.parametrize("columns", [40, 60, 80, 200])
def test_summary_of_a_run_says_all_its_figures(run, columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    narrow = SafeConsole(width=columns, file=io.StringIO())
    data = read_run(run)
    narrow.print(summary_table(figures(data.records, data.timings), "made"))
    said = narrow.file.getvalue()
    assert "…" not in said
    assert said.count("0.33") >= 2
    assert said.count("24.69") >= 2
    assert max(map(len, said.splitlines())) <= columns


def test_goals_of_a_task_are_counted_alike_in_all_columns(run):
    wide = SafeConsole(width=200, file=io.StringIO())
    wide.print(task_table(read_run(run).records))
    rows = [
        [cell.strip() for cell in line.strip("│").split("│")]
        for line in wide.file.getvalue().splitlines()
        if line.startswith("│ task-")
    ]
    assert [row[2:5] for row in rows] == [
        ["3 of 4", *2 * [one]] for one in ("✓", "✗ 2/3", "✗ 1/3") * 3
    ]


def test_bar_says_what_is_left_only_as_long_as_something_is():
    shown = SafeConsole(width=100, file=io.StringIO(), force_terminal=True)
    (*_, left) = bar().columns
    task = Task(TaskID(0), "x", 4, 2, _get_time=lambda: 20.0)
    task.start_time = 0.0
    assert left.render(task).plain == ""  # nothing is known yet
    task._progress.extend([ProgressSample(0.0, 0), ProgressSample(10.0, 2)])
    assert left.render(task).plain == "left 0:00:10"
    task.completed, task.finished_time = 4, 20.0
    assert left.render(task).plain == ""
    assert shown.file.getvalue() == ""


def test_module_is_the_command_line():
    said = [
        subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout
        for command in ([sys.executable, "-m", "karma"], [sys.executable, "-c", PLAIN])
    ]
    assert said[0] == said[1] == f"karma-offline {__version__}\n"
    done = subprocess.run(
        [sys.executable, "-m", "karma", "eval", "no.toml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "no.toml" in done.stderr
