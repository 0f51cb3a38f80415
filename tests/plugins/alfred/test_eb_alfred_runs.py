"""Whole runs of EB-ALFRED: resumed, with workers, and with bad files."""

import re

import pytest
from support.eb_alfred import finished
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma.bench.engine.run import Run
from karma.cli import app
from karma.errors import FileError
from karma.journal.folder import TABLE


def test_run_gives_equal_bytes_twice_and_with_two_workers(experiment, tmp_path):
    path = experiment()
    records, first = finished(path, tmp_path / "a")
    assert len(records) == 12
    assert finished(path, tmp_path / "b")[1] == first
    assert finished(path, tmp_path / "c", workers=2)[1] == first


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"subsets": ["basic"]}, "no list 'basic'"),
        ({"only": ["base/7"]}, "no task 'base/7'"),
        ({"seeds": []}, "seeds = []"),
        ({"colour": "red"}, "unknown field `colour`"),
        ({"types": "/nowhere/types.json"}, "/nowhere/types.json"),
    ],
)
def test_experiment_that_is_wrong_is_refused_and_named(experiment, tmp_path, changed, message):
    with pytest.raises(FileError, match=re.escape(message)):
        finished(experiment(**changed), tmp_path / "a")


def test_command_prints_the_table_and_refuses_what_a_benchmark_does_not_know(experiment, tmp_path):
    path, out = experiment(), tmp_path / "run"
    done = CliRunner().invoke(app, ["eval", str(path), "--out", str(out), "--workers", "1"])
    assert done.exit_code == 0, done.output
    assert "| expert | 4/4 |" in done.output
    wrong = CliRunner().invoke(app, ["eval", str(path), "--out", str(out), "--no-steps"])
    assert wrong.exit_code != 0
    assert "has no --steps" in wrong.output


def test_table_command_writes_the_table_of_a_run_also_of_one_that_is_not_finished(
    experiment, tmp_path
):
    path, out = experiment(), tmp_path / "run"
    steps = Run(path, out).episodes()
    next(steps)
    steps.close()
    done = CliRunner().invoke(app, ["table", str(out)])
    assert done.exit_code == 0, done.output
    assert "| expert | 1/1 |" in done.output
    finished(path, out)
    whole = (out / TABLE).read_bytes()
    (out / TABLE).unlink()
    assert CliRunner().invoke(app, ["table", str(out)]).exit_code == 0
    assert (out / TABLE).read_bytes() == whole


TINY = """
[[rows]]
name = "tiny"
prompt = {{ constrained = true, most_text = 0, most_actions = 2, examples = 0 }}
[models]
planner = "{}"
n_ctx = 6000
"""


def test_planner_in_process_under_the_grammar_gives_equal_bytes_and_listed_actions(
    experiment, tmp_path
):
    planner = export_tiny(tmp_path / "tiny.gguf")
    path = experiment(TINY.format(planner), only=["base/0", "spatial/0"])
    records, one = finished(path, tmp_path / "one")
    assert finished(path, tmp_path / "two", workers=2)[1] == one
    answers = [answer for record in records for answer in record.answers]
    assert answers
    assert {(answer.constrained, answer.no_json, answer.error) for answer in answers} == {
        (True, False, "")
    }
    table = one[TABLE].decode()
    assert "context of 6000 tokens may be longer than what it was trained for" in table
    assert "tiny: answers are held to the JSON" in table
