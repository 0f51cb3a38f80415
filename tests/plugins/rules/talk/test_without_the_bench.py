"""The product stands alone: an agent is made, told and asked with the bench made unimportable."""

import subprocess
import sys

import pytest

BARRED = """
import sys
BARRED = ("karma.bench", "karma.plugins.training", "karma.plugins.airgap")
class Barred:
    def find_spec(self, name, path=None, target=None):
        if name.startswith(BARRED):
            raise ImportError(f"{name} is not here")
sys.meta_path.insert(0, Barred())
"""


def alone(tmp_path, code, **more):
    done = subprocess.run(
        [sys.executable, "-c", BARRED + code], cwd=tmp_path, capture_output=True, text=True,
        check=False, **more,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_is_barred_cannot_be_imported(tmp_path):
    code = "import karma.bench.engine.run"
    done = subprocess.run(
        [sys.executable, "-c", BARRED + code], cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert "karma.bench is not here" in done.stderr


@pytest.mark.model
def test_agent_is_made_told_and_asked(tmp_path):
    code = """
from karma import Agent
agent = Agent("kitchen_1", planner="karma-nano", folder="talk", home="here")
print(agent.do("open the fridge").status)
print(agent.do("is the fridge open?").status)
print(agent.do("close the curtains").status)
"""
    said = alone(tmp_path, code).split()
    assert said == ["done", "answered", "refused"]
    names = {one.name for one in (tmp_path / "talk").iterdir()}
    assert {"header.json", "episodes.jsonl", "steps"} <= names


@pytest.mark.model
def test_commands_of_a_person_run(tmp_path):
    code = """
from karma.cli import main
for words in (["run", "open the fridge", "--planner", "karma-nano"],
              ["read", "open the fridge"], ["home", "list"],
              ["chat", "--planner", "karma-nano", "--scene", "kitchen_1"]):
    sys.argv = ["karma", *words]
    try:
        main()
    except SystemExit as end:
        print("ended with", end.code)
"""
    said = alone(tmp_path, code, input="where is the mug?\n")
    assert said.count("ended with 0") == 4, said
