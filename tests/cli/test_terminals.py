"""What is printed fits the terminal that is there, and errors have a length that can be read."""

import io
import json
import subprocess
import sys

import pytest
from support.made_records import episode, sub, write_run
from typer.testing import CliRunner

from karma import __version__
from karma.bench.figures.columns import figures
from karma.cli import app, shared
from karma.cli.shared import SafeConsole
from karma.cli.show import summary_table
from karma.journal.records import EpisodeTiming, SubTaskTiming
from karma.journal.run_folder import read_run

PLAIN = "from karma.cli import app; app()"


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
            records.append(one)
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
    table = [line for line in done.output.splitlines() if line.startswith(("│", "┃", "┏"))]
    assert max(map(len, table)) <= int(columns)


@pytest.mark.parametrize("columns", [60, 80, 200])
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
