"""Whole runs of LoTa-Bench's ALFRED: with workers, random weights, a server, bad files."""

import json
import re

import pytest
from support import alfred_kitchen as ours
from support.eb_alfred import finished, hosted
from support.hosted_server import chat, plant_key, wire_server
from support.lota_alfred import FETCH, STOW, trial
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma.bench.engine.run import Run
from karma.cli import app
from karma.errors import FileError, ModelError
from karma.journal.folder import TABLE
from karma.plugins.alfred.suites.table import LOTA_TABLES, figures_of
from karma.plugins.hosted.cassette import Cassette

ROWS = """
[[rows]]
name = "expert"
player = "expert"
[[rows]]
name = "expert, strict"
player = "expert"
strict = true
[[rows]]
name = "chance"
player = "chance"
"""
SCORED = """
[[rows]]
name = "scored"
[[rows]]
name = "average, failures told"
scoring = "average"
prompt = {{ failures = true, examples = 2 }}
[[rows]]
name = "generated"
player = "generated"
prompt = {{ examples = 1, max_tokens = 40 }}
[models]
planner = "{}"
"""


@pytest.fixture
def lota(experiment, tmp_path):
    """A function that writes an experiment over our kitchen and returns its path."""
    experiment()  # the files that both benchmarks need
    ours.write(tmp_path / "trials.jsonl", trial())

    def write(rows=ROWS, *, trials=("ours_1", "ours_1"), **changed):
        entries = [
            {"task": f"pick_and_place_simple-Apple-None-Fridge-7/{one}", "repeat_idx": 0}
            for one in trials
        ]
        (tmp_path / "lists.json").write_text(json.dumps({"valid_seen": entries}))
        fields = {
            "name": "x", "benchmark": "lota_alfred", "tasks": str(tmp_path / "lists.json"),
            "types": str(tmp_path / "types.json"), "trials": str(tmp_path / "trials.jsonl"),
            **changed,
        }  # fmt: skip
        path = tmp_path / "lota.toml"
        path.write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in fields.items()) + rows)
        return path

    return write


def test_run_of_a_model_gives_equal_bytes_with_two_workers(lota, tmp_path):
    path = lota(SCORED.format(export_tiny(tmp_path / "tiny.gguf")))
    records, first = finished(path, tmp_path / "a")
    assert finished(path, tmp_path / "b", workers=2)[1] == first
    assert {record.end for record in records} <= {"done", "steps", "plan over", "empty plan"}
    for record in records:
        for answer in record.answers:
            assert answer.prompt_tokens > 100
            assert (answer.score is None) == (record.row == "generated")


def test_trial_that_is_missing_is_in_no_rate_and_most_of_them_are_an_error(lota, tmp_path):
    path = lota(trials=("ours_1", "lost"))
    run = Run(path, tmp_path / "a")
    records = list(run.episodes())
    expert = figures_of(records, LOTA_TABLES)[0]
    told = {"row": "expert", "kind": "all", "success": 1.0, "episodes": 1, "crashed": 0}
    assert told.items() <= expert.items()
    assert {(one.task, one.reason) for one in run.not_run} == {
        ("valid_seen/1", "there is no trial lost")
    }
    said = karma_eval(path, tmp_path / "a", code=1)
    assert "3 not run, in no rate (expert 1, expert, strict 1, chance 1)" in said
    assert "there is no trial lost" in said
    assert not (tmp_path / "a" / TABLE).exists()
    CliRunner().invoke(app, ["table", str(tmp_path / "a")])
    assert "not run, in no rate" in (tmp_path / "a" / TABLE).read_text()
    path = lota(trials=("lost", "ours_1", "gone"))
    with pytest.raises(FileError, match="holds 1 of the 3 trials that are listed"):
        list(Run(path, tmp_path / "b").episodes())


def karma_eval(path, folder, code):
    words = ["eval", str(path), "--out", str(folder), "--workers", "1"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == code, result.output
    return result.output


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"lists": ["valid_unseen"]}, "no list 'valid_unseen'"),
        ({"percent": 0}, "percent"),
        ({"percent": 30}, "no task is drawn"),
        ({"only": ["valid_seen/7"]}, "no task 'valid_seen/7'"),
        ({"seeds": []}, "seeds = []"),
        ({"subsets": ["base"]}, "unknown field `subsets`"),
        ({"rows": "[[rows]]\nname = 'r'\nplayer = 'planner'\n"}, "'planner'"),
    ],
)
def test_experiment_that_is_wrong_is_refused_and_named(lota, tmp_path, changed, message):
    rows = changed.pop("rows", ROWS)
    with pytest.raises(FileError, match=re.escape(message)):
        finished(lota(rows, **changed), tmp_path / "a")


def listing(path, body, headers):
    """Answers with the whole list."""
    text = ", ".join(f"{n}. {step}" for n, step in enumerate((*FETCH, *STOW, "done"), 1))
    return chat(text, usage={"prompt_tokens": 9, "completion_tokens": 9, "total_tokens": 18})


def test_hosted_run_writes_whole_lists_and_is_replayed_to_the_byte(lota, tmp_path, monkeypatch):
    plant_key(monkeypatch)
    with wire_server(listing) as (url, seen):
        path = lota(hosted(url, 'name = "hosted"\nplayer = "generated"'))
        tape = Cassette(tmp_path / "tape", "record")
        records, first = finished(path, tmp_path / "a", cassette=tape)
        assert [record.success for record in records] == [True, True]
        asked = len(seen)
        tape = Cassette(tmp_path / "tape", "replay")
        assert finished(path, tmp_path / "b", cassette=tape)[1] == first
        assert len(seen) == asked == 2


def test_hosted_run_that_is_to_score_is_refused_and_says_what_to_take(lota, tmp_path, monkeypatch):
    plant_key(monkeypatch)
    with wire_server(listing) as (url, _):
        path = lota(hosted(url, 'name = "hosted"\nplayer = "scored"'))
        with pytest.raises(ModelError, match=r'hosted needs log-prob.*player = "generated"'):
            finished(path, tmp_path / "a")
