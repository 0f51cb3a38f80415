"""What is seen of an answer while it comes, and what becomes of one that the clock cuts off."""

import json
from io import StringIO
from pathlib import Path

import pytest
from support.talking import STORE, agent_saying
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma import Agent
from karma.cli import app, conversation, progress
from karma.cli.conversation import say
from karma.cli.progress import AnswerView
from karma.cli.shared import SafeConsole
from karma.errors import KarmaError
from karma.journal.run_folder import read_run
from karma.types.completion import Heard

NO_TIME = "0.000001"  # is over before a prompt is read


def heard(*texts):
    return [Heard(text=text, tokens=n, seconds=n / 2) for n, text in enumerate(texts, 1)]


def test_last_line_of_an_answer_without_a_newline_stands_before_what_it_came_to(
    tmp_path, monkeypatch
):
    both, view = StringIO(), AnswerView()
    monkeypatch.setattr(conversation, "console", SafeConsole(file=both, width=100))
    view._errors = SafeConsole(file=both, width=100)
    say(agent_saying(tmp_path, [STORE.rstrip("\n")], listen=view.hear), "store the apple", view)
    shown = both.getvalue()
    last = STORE.rstrip("\n").rpartition("\n")[2]
    assert shown.count(last) == 1
    assert shown.index(last) < shown.index("1. store the apple")


def test_lines_go_to_standard_error_when_they_are_whole_and_nothing_else_changes(tmp_path, capsys):
    for name in ("quiet", "told"):
        (tmp_path / name).mkdir()
    say(agent_saying(tmp_path / "quiet", [STORE]), "put the apple in the fridge")
    quiet = capsys.readouterr()
    view = AnswerView()
    told = agent_saying(tmp_path / "told", [STORE], listen=view.hear)
    say(told, "put the apple in the fridge", view)
    loud = capsys.readouterr()
    assert quiet.err == ""
    assert loud.out == quiet.out
    first, *lines = loud.err.splitlines()
    assert first == "answer 1, first heard of after 0.0 s:"
    assert [line.partition("  (")[0].strip() for line in lines] == STORE.splitlines()
    assert all(line.endswith("tokens, 0.0 s)") for line in lines)


def test_each_answer_has_its_number_and_why_it_was_refused(tmp_path, capsys):
    view = AnswerView()
    agent = agent_saying(tmp_path, ["nothing\n", "refuse('deed')\n"], listen=view.hear)
    say(agent, "wash the apple, then slice the bread", view)
    err = capsys.readouterr().err
    assert "  refused: line 1" in err
    assert err.count("answer 1,") == 2  # of either request


def test_first_token_is_told_of_before_any_line_is_whole(capsys):
    view = AnswerView()
    view.hear(heard("Go")[0])
    assert capsys.readouterr().err == "answer 1, first heard of after 0.5 s:\n"


@pytest.mark.parametrize("terminal", [True, False])
def test_what_a_model_says_steers_no_terminal_and_is_no_markup(terminal, monkeypatch, capsys):
    screen = StringIO()
    console = SafeConsole(force_terminal=terminal, file=screen, width=80)
    monkeypatch.setattr(progress, "console", console)
    view = AnswerView()
    status = console.status("thinking ...")
    view.request(status)
    for one in heard("\x1b[2J[bold]", "x\u202ey\n", "[/nothing]\n"):
        view.hear(one)
    console.print(status.renderable)
    shown = screen.getvalue() if terminal else capsys.readouterr().err
    assert "\\x1b[2J[bold]x\\u202ey" in shown
    assert "[/nothing]" in shown
    assert "\x1b[2J" not in shown


def test_terminal_shows_the_last_lines_under_way_with_tokens_and_seconds(monkeypatch):
    screen = StringIO()
    console = SafeConsole(force_terminal=True, file=screen, width=60)
    monkeypatch.setattr(progress, "console", console)
    view = AnswerView()
    status = console.status("thinking ...")
    view.request(status)

    def shown():
        screen.truncate(0)
        console.print(status.renderable)
        return screen.getvalue()

    view.hear(heard("GoTo")[0])
    assert "thinking, answer 1: 1 tokens, 0.5 s" in shown() and "GoTo" in shown()
    for one in heard(*(f"line {number}\n" for number in range(40)), "wide " * 100):
        view.hear(one)
    last = shown()
    assert "line 39" in last and "line 3\n" not in last
    assert "41 tokens, 20.5 s" in last
    assert len(last.splitlines()) <= 10


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return str(export_tiny(tmp_path / "tiny.gguf"))


def test_answers_without_time_are_asked_again_never_carried_out_and_end_honestly(tiny):
    done = CliRunner().invoke(
        app,
        ["run", "take the apple", "--planner", tiny, "--profile", "compact", "--answer-seconds",
         NO_TIME, "--json", "reply.json"],
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


@pytest.mark.parametrize("command", [["run", "take the apple"], ["chat"]])
@pytest.mark.parametrize("switch", [[], ["--no-chat"]])
def test_first_line_says_whether_a_chat_template_is_used(command, switch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    template = "{% for m in messages %}[{{ m.role }}] {{ m.content }}\n{% endfor %}"
    planner = str(export_tiny(tmp_path / "tiny.gguf", template))
    options = ["--planner", planner, "--profile", "compact", "--answer-seconds", NO_TIME, *switch]
    done = CliRunner().invoke(app, [*command, *options], input="")
    way = "without" if switch else "through"
    assert done.stdout.splitlines()[0] == f"planner: {planner}, {way} its own chat template"


def test_first_line_says_nothing_of_a_model_without_a_template(tiny):
    options = ["--planner", tiny, "--profile", "compact", "--answer-seconds", NO_TIME]
    done = CliRunner().invoke(app, ["run", "take the apple", *options])
    assert done.stdout.splitlines()[0] == "1. take the apple"


def test_agent_bounds_its_answers_unless_told_otherwise(tmp_path):
    agent = agent_saying(tmp_path, [])
    assert agent.method.planner.decoding.answer_seconds == 120
    with pytest.raises(KarmaError, match="answer_seconds = -1"):
        Agent("kitchen_1", answer_seconds=-1)
