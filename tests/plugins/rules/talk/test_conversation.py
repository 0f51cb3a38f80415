"""`karma chat` in a terminal, or piped: what is said, what begins with a slash, how it ends."""

import sys
from io import StringIO

import pytest
from support.talking import AWAY, STORE, TAKE, agent_saying
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma.assistant.protocol import Resolved
from karma.cli import app
from karma.cli.conversation import converse, say
from karma.cli.shared import console
from karma.models.scripted import ScriptedModel
from karma.plugins.rules.talk.offers import pending


@pytest.fixture
def talk(tmp_path, monkeypatch, capsys):
    """A function that pipes lines to an agent that says the given programs; returns the rows."""
    monkeypatch.setattr(console, "_width", 80)

    def talked(answers, *lines, agent=None):
        monkeypatch.setattr(sys, "stdin", StringIO("".join(f"{line}\n" for line in lines)))
        converse(agent or agent_saying(tmp_path, answers))
        return capsys.readouterr().out.splitlines()

    return talked


def answers_in(rows):
    """The rows after each line that was typed."""
    found = [[]]
    for row in rows:
        if row.startswith("> "):
            found.append([])
        else:
            found[-1].append(row)
    return found[1:]


def test_conversation_remembers_and_ends_with_its_input(talk):
    rows = talk([TAKE, AWAY], "take the apple", "put it in the fridge", "/memory")
    *_, last = answers_in(rows)
    assert any(row.startswith("  Apple in the fridge") for row in last)
    assert rows[-1].startswith("run: ")


def test_understanding_stands_before_what_was_done(talk):
    (rows,) = answers_in(talk([STORE], "put the apple in the fridge"))
    starts = ("1. put", "  apple →", "  I will", "  done:", "  the apple is in")
    at = [rows.index(next(row for row in rows if row.startswith(start))) for start in starts]
    assert at == sorted(at)


def test_refusal_is_told_with_a_question(talk):
    (rows,) = answers_in(talk(["refuse('language')\n"], "mach den Becher kaputt"))
    assert any("I understand English only" in row for row in rows)
    assert any("Say it in English" in row for row in rows)
    assert not any(row.startswith("  done") for row in rows)


def test_an_answer_to_what_was_asked_back_goes_on_with_the_errand(tmp_path):
    agent = agent_saying(tmp_path, [STORE, STORE])
    asked = agent.do("put the apple in")
    assert pending(asked) is not None

    def resolved(typed, at_terminal=True):
        return agent.assistant.resolve(typed, at_terminal=at_terminal)

    whole = "put the apple in the fridge"
    assert resolved("the fridge") == Resolved(whole, f"so: {whole}")
    assert resolved("the fridge", at_terminal=False) == Resolved("the fridge")
    other = "take the apple"
    assert resolved(other) == Resolved(other, "that in place of: put the apple in")
    assert resolved("/map") == Resolved("/map")
    assert resolved("take that back") == Resolved("/undo")
    assert agent.do(whole)
    assert resolved(other) == Resolved(other)


def test_undo_and_why_and_map_and_help_answer(talk):
    rows = talk(
        [TAKE], "/undo", "/why", "take the apple", "/why", "/map", "/undo", "/memory", "/help", "/x"
    )
    nothing, unsaid, _, why, room, undone, memory, told, unknown = answers_in(rows)
    assert nothing == ["nothing to undo"]
    assert unsaid == ["nothing was said yet"]
    assert any("PickupObject(robot, 'Apple" in row for row in why)
    assert any("Fridge" in row for row in room)
    assert undone == ["undone: take the apple"]
    assert memory[0].startswith("short-term memory: 0 of")
    assert {"/memory", "/map", "/undo", "/why", "/help", "/quit"} <= {
        word for row in told for word in row.split()
    }
    assert "/help" in unknown[0]


def test_quit_ends_before_what_follows(talk):
    assert len(answers_in(talk([], "/quit", "take the apple"))) == 1


def test_error_of_a_model_does_not_end_the_conversation(talk):
    failed, memory = answers_in(talk([], "take the apple", "/memory"))
    assert failed[-1].startswith("error: the script has run out")
    assert memory[0].startswith("short-term memory")


class Stopped(ScriptedModel):
    """A model during whose answer somebody presses Ctrl-C."""

    def complete(self, prompt, **options):
        raise KeyboardInterrupt


def test_ctrl_c_stops_what_it_does_and_what_follows_from_a_pipe(talk, tmp_path):
    agent = agent_saying(tmp_path, [], model=Stopped())
    (stopped,) = answers_in(talk([], "take the apple", "/memory", agent=agent))
    assert stopped[-1].startswith("stopped; all is as it was")
    assert len(agent.memory) == 0
    assert agent.replies == []


@pytest.mark.parametrize("end", [EOFError, KeyboardInterrupt])
def test_ctrl_d_and_ctrl_c_at_the_prompt_end_it(end, tmp_path, monkeypatch, capsys):
    class Terminal(StringIO):
        def isatty(self):
            return True

    def pressed(*_, **__):
        raise end

    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr("builtins.input", pressed)
    converse(agent_saying(tmp_path, []))
    assert "Traceback" not in capsys.readouterr().out


def test_words_of_a_request_are_shown_as_they_are(talk):
    (rows,) = answers_in(talk([TAKE], "take the [bold]apple"))
    assert rows[0] == "1. take the [bold]apple"


def test_reply_is_what_python_gets(tmp_path, capsys):
    agent = agent_saying(tmp_path, [STORE])
    assert say(agent, "put the apple in the fridge") is agent.replies[0]


def test_command_talks_until_quit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    planner = str(export_tiny(tmp_path / "tiny.gguf"))
    options = ["--planner", planner, "--profile", "compact", "--scene", "kitchen_1"]
    done = CliRunner().invoke(app, ["chat", *options], input="/memory\n/quit\n")
    assert done.exit_code == 0, done.output
    assert "short-term memory: 0 of 10" in done.output
