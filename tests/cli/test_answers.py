"""An answer while it comes, and an answer that its time limit cuts off."""

import json
from io import StringIO
from pathlib import Path

import pytest
from support.talking import agent_saying
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma import Agent
from karma.cli import app, progress
from karma.cli.progress import AnswerView
from karma.cli.shared import SafeConsole
from karma.errors import KarmaError
from karma.journal.run_folder import read_run
from karma.types.completion import Heard


def test_terminal_shows_the_last_lines_of_an_answer_and_obeys_none(monkeypatch):
    screen = StringIO()
    console = SafeConsole(force_terminal=True, file=screen, width=60)
    monkeypatch.setattr(progress, "console", console)
    view = AnswerView()
    status = console.status("thinking ...")
    view.request(status)
    texts = [*(f"line {number}\n" for number in range(40)), "\x1b[2J[bold]x[/nothing]"]
    for number, text in enumerate(texts, 1):
        view.hear(Heard(text=text, tokens=number, seconds=number / 2))
    console.print(status.renderable)
    shown = screen.getvalue()
    assert "thinking, answer 1: 41 tokens, 20.5 s" in shown
    assert "line 39" in shown and "line 3\n" not in shown
    assert "\\x1b[2J[bold]x[/nothing]" in shown and "\x1b[2J" not in shown


def test_answers_without_time_are_asked_again_never_carried_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    planner = str(export_tiny(tmp_path / "tiny.gguf"))
    done = CliRunner().invoke(
        app,
        ["run", "take the apple", "--planner", planner, "--profile", "compact",
         "--answer-seconds", "0.000001", "--json", "reply.json"],
    )  # fmt: skip
    assert done.exit_code == 4, done.output
    assert "not finished: line 1: the answer was cut off after 1e-06 s" in done.output
    (record,) = read_run(Path("runs/talks/kitchen_1-1")).records
    assert record.timed_out
    (part,) = record.subtasks
    assert [one.finish for one in part.answers] == ["time"] * 4
    assert part.calls == ()
    (kept,) = json.loads(Path("reply.json").read_text())["instructions"]
    assert [one["finish"] for one in kept["answers"]] == ["time"] * 4


def test_agent_bounds_its_answers_by_default(tmp_path):
    agent = agent_saying(tmp_path, [], assistant="direct")
    assert agent.method.planner.decoding.answer_seconds == 120
    with pytest.raises(KarmaError, match="answer_seconds = -1"):
        Agent("kitchen_1", answer_seconds=-1)
