"""The quickstart runs as it stands: the page, the transcript, the reference."""

import re

import make_transcript
import pytest
from support.needs import need_models
from support.paths import ROOT
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma.cli import app

PAGE = ROOT / "docs" / "quickstart.md"


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """A function that returns what a program prints in an empty folder."""

    def run(code):
        monkeypatch.chdir(tmp_path)
        exec(compile(code, "quickstart", "exec"), {"__name__": "__main__"})
        return capsys.readouterr().out

    return run


@pytest.mark.model
def test_page_runs_from_the_first_line_to_the_last(run):
    need_models("karma-nano")
    code = "\n".join(
        re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    )
    said = run(code)
    assert "short-term memory:" in said
    assert "undone: put it in the fridge" in said
    assert "runs/talks/kitchen_1-1" in said
    assert "Agent('kitchen_2')" in said


def test_first_lines_of_python_are_five():
    first = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len([line for line in first[1].splitlines() if line.strip()]) == 5


@pytest.fixture
def transcript(monkeypatch, tmp_path):
    """A function that returns the page of some talks, held in this process."""

    def printed(talk, options, folder):
        monkeypatch.chdir(folder)
        said = "".join(f"{words}\n" for _, words in talk.said)
        words = ["chat", *talk.options, *options]
        done = CliRunner().invoke(app, words, input=said, env={"COLUMNS": "80"})
        assert done.exit_code in (0, 3, 4, 5), done.output
        return done.stdout.splitlines()

    def page(text, **options):
        said, out = tmp_path / "said.txt", tmp_path / "x.md"
        said.write_text(text, encoding="utf-8")
        make_transcript.main(said=said, out=out, **options)
        return out.read_text(encoding="utf-8")

    monkeypatch.setattr(make_transcript, "printed", printed)
    return page


def test_transcript_has_what_was_said_and_counts_what_became_of_it(transcript, tmp_path):
    planner = export_tiny(tmp_path / "tiny.gguf")
    said = "@ kitchen_1\n+ open the fridge\n- sing\n"
    page = transcript(said, planner=str(planner), profile="compact")
    assert "> open the fridge" in page and "> sing" in page
    assert "| can be done there | 1 |" in page


def test_list_of_the_transcript_has_thirty_requests_of_both_kinds():
    lines = (ROOT / "eval" / "talk" / "said.txt").read_text(encoding="utf-8").splitlines()
    kinds = [line[0] for line in lines if line[:1] in ("+", "-")]
    assert len(kinds) == 30
    assert min(kinds.count("+"), kinds.count("-")) >= 10


def test_transcript_in_the_documents_is_of_that_list():
    page = (ROOT / "docs" / "plugins" / "transcript.md").read_text(encoding="utf-8")
    lines = (ROOT / "eval" / "talk" / "said.txt").read_text(encoding="utf-8").splitlines()
    said = [line[2:] for line in lines if line[:1] in ("+", "-", "?")]
    assert re.findall(r"^> (.*)$", page, re.MULTILINE) == said


def test_days_in_homes_are_as_the_page_has_them(transcript):
    """All but how sure a planner is, of which processors may differ in the last digits."""
    said = (ROOT / "eval" / "talk" / "said.txt").read_text(encoding="utf-8")
    homes = [talk for talk in said.split("@ ")[1:] if len(talk.splitlines()[0].split()) > 1]

    def told(text):
        talks = [talk for talk in text.split("\n## ")[1:] if "--home" in talk]
        assert len(talks) == 5
        lines = (line for talk in talks for line in talk.splitlines())
        return [line for line in lines if line and not line.startswith("  sure:")]

    page = (ROOT / "docs" / "plugins" / "transcript.md").read_text(encoding="utf-8")
    assert told(transcript("".join(f"@ {talk}" for talk in homes))) == told(page)


def test_conversation_on_the_front_page_stands_in_the_transcript():
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    page = (ROOT / "docs" / "plugins" / "transcript.md").read_text(encoding="utf-8").splitlines()
    shown = front.partition("shortened (")[2].split("```")[1].strip("\n").splitlines()
    lines = [line.partition("   ")[0] if line.startswith(">") else line for line in shown]
    assert len(lines) >= 8
    assert set(lines) <= set(page)


def test_reference_is_written_from_the_docstrings(tmp_path):
    pdoc = pytest.importorskip("pdoc")
    pdoc.render.configure(docformat="google", search=False, show_source=False)
    pdoc.pdoc("karma.assistant.agent", output_directory=tmp_path)
    page = (tmp_path / "karma/assistant/agent.html").read_text(encoding="utf-8")
    assert "Go back to before the last thing that was said" in page
    assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=[\"']https?://", page)
