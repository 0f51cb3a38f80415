"""Assistants: which one an agent has, and what `direct` does without any plug-in."""

import subprocess
import sys
from importlib.metadata import EntryPoints

import pytest
from support.needs import need_models
from support.talking import STORE, agent_saying
from typer.testing import CliRunner

from karma import registry
from karma.assistant.protocol import wanted_assistant
from karma.cli import app
from karma.errors import UnknownNameError
from karma.models.manifest import resolve_planner


def without(monkeypatch, *plug_ins):
    """Let nothing of some plug-ins be registered."""
    whole = registry._installed()
    places = tuple(f"karma.plugins.{name}." for name in plug_ins)
    points = (one for group in whole.groups for one in whole.select(group=group))
    kept = EntryPoints(one for one in points if not one.value.startswith(places))
    monkeypatch.setattr(registry, "_installed", lambda: kept)


def test_manifest_says_which_assistant_a_planner_wants(monkeypatch):
    assert wanted_assistant("karma-nano") == wanted_assistant("karma-mini") == "rules"
    assert wanted_assistant("some.gguf") == "direct"
    without(monkeypatch, "rules")
    assert wanted_assistant("karma-nano") == "direct"


def test_without_the_packages_of_a_plug_in_its_assistant_is_not_taken():
    code = """import sys
sys.modules["spacy"] = None
from karma import registry
from karma.assistant.protocol import wanted_assistant
print(wanted_assistant("karma-nano"))
try:
    registry.load("assistants", "rules")
except Exception as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[0] == "direct"
    assert "pip install 'karma-offline[rules]'" in done.stdout


def test_direct_gives_the_text_to_the_planner_as_it_is_and_prints_the_report(tmp_path):
    agent = agent_saying(tmp_path, [STORE], assistant="direct")
    text = "the apple, please, and then fridge"
    reply = agent.do(text)
    assert f"#task {text}" in agent.method.planner.model.prompts[0].changing
    assert reply.status == "done"
    assert " ".join(repr(reply).split()).startswith(
        f"{text} I will take the apple, open the fridge, put the apple in the fridge, "
        "close the fridge done: "
    )
    assert "  the apple is in the fridge: seen" in repr(reply).splitlines()
    assert agent.home.past[-1].said == text


def test_direct_says_why_the_planner_refuses(tmp_path):
    reply = agent_saying(tmp_path, ["refuse('deed')\n"], assistant="direct").do("sing")
    assert reply.status == "refused"
    assert "  not done: I have no skill for that." in repr(reply).splitlines()


def test_planner_works_without_plug_ins_and_what_is_missing_is_named(tmp_path, monkeypatch):
    need_models("karma-nano")
    monkeypatch.chdir(tmp_path)
    without(monkeypatch, "rules", "homes")
    bare = tmp_path / "bare.gguf"  # without its words file, which only the plug-in reads
    bare.symlink_to(resolve_planner("karma-nano").path)
    run = ["run", "put the apple in the fridge", "--profile", "compact"]
    done = CliRunner().invoke(app, [*run, "--planner", str(bare)])
    assert done.exit_code == 0, done.output
    assert "the apple is in the fridge: seen" in done.output
    for option, extra in (
        (["--assistant", "rules"], "rules"),
        (["--home", "mine"], "homes"),
        (["--planner", "karma-nano"], "rules"),
    ):
        refused = CliRunner().invoke(app, [*run, "--planner", str(bare), *option])
        assert refused.exit_code == 1
        assert f"pip install 'karma-offline[{extra}]'" in refused.output


def test_unknown_assistant_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match="no assistants named 'rule'"):
        agent_saying(tmp_path, [], assistant="rule")
