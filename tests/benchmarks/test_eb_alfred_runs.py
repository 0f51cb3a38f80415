"""Whole runs of EB-ALFRED: resumed, with workers, with a hosted model, and with bad files."""

import json
import re

import pytest
from support import alfred_kitchen as ours
from support import eb_alfred as eb
from support.hosted_server import plant_key, wire_server
from typer.testing import CliRunner

from karma.benchmarks.eb_alfred.run import EPISODES, RESULTS, TABLE, BenchmarkRun
from karma.benchmarks.eb_alfred.table import results_of
from karma.cli import app
from karma.errors import FileError, KarmaError
from karma.infer.hosted.cassette import Cassette
from karma.world.eb_alfred.actions import PUT

ROWS = """
[[rows]]
name = "expert"
player = "expert"
[[rows]]
name = "expert (strict)"
player = "expert"
strict = true
[[rows]]
name = "chance"
player = "chance"
"""
HOSTED = """
[[rows]]
name = "hosted"
[models]
planner = "openai"
[models.hosted.planner]
base_url = "{url}"
model = "m"
dialect = "plain"
"""


@pytest.fixture
def experiment(tmp_path, monkeypatch):
    """A function that writes an experiment over our kitchen and returns its path."""
    shared = tmp_path / "ref"
    (shared / "data/alfred").mkdir(parents=True)
    (shared / "data/thor5").mkdir()
    ours.write(shared / "data/thor5/scenes.jsonl.gz", ours.dump())
    ours.write(shared / "data/alfred/layouts.json.gz", ours.layout())
    monkeypatch.setenv("KARMA_SHARED", str(shared))
    types, trials = eb.types_file(tmp_path), ours.write(tmp_path / "trials.jsonl", ours.trial())
    published = tmp_path / "published.csv"
    published.write_text("model,subset,score\nDeep Thought,average,42\nDeep Thought,base,41.5\n")

    def write(rows=ROWS, *, tasks=None, **changed):
        lists = {
            "base": [("ours_1", "Put the apple into the fridge."), ("ours_1", "Cool some fruit.")],
            "spatial": [("ours_1", "The apple goes into the fridge."), ("lost", "Find it.")],
        }
        given = {
            name: [
                {"task": f"x/{one}", "repeat_idx": 0, "instruction": text} for one, text in found
            ]
            for name, found in (tasks or lists).items()
        }
        (tmp_path / "splits.json").write_text(json.dumps(given))
        fields = {
            "name": "x", "benchmark": "eb_alfred", "tasks": str(tmp_path / "splits.json"),
            "types": str(types), "trials": str(trials), "published": str(published), **changed,
        }  # fmt: skip
        path = tmp_path / "x.toml"
        path.write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in fields.items()) + rows)
        return path

    return write


def contents(folder):
    return {name: (folder / name).read_bytes() for name in (EPISODES, RESULTS, TABLE)}


def finished(path, folder, workers=1, **more):
    run = BenchmarkRun(path, folder, **more)
    return list(run.episodes(workers)), contents(folder)


def test_run_gives_equal_bytes_twice_and_with_two_workers(experiment, tmp_path):
    path = experiment()
    records, first = finished(path, tmp_path / "a")
    assert len(records) == 12
    assert finished(path, tmp_path / "b")[1] == first
    assert finished(path, tmp_path / "c", workers=2)[1] == first


def test_run_counts_a_missing_trial_as_failed_and_says_so(experiment, tmp_path):
    records, files = finished(experiment(), tmp_path / "a")
    figures = {(one.row, one.subset): one for one in results_of(records)}
    assert (figures["expert", "base"].success, figures["expert", "spatial"].success) == (1.0, 0.5)
    average = figures["expert", "average"]
    assert (average.success, average.successes, average.errors) == (0.75, 3, 1)
    assert "there is no trial lost" in files[EPISODES].decode()
    assert "| **expert** | 75.0 | 100.0 | – | – | – | 50.0 | – |" in files[TABLE].decode()
    assert "| Deep Thought | 42.0 | 41.5 | – |" in files[TABLE].decode()


def test_run_that_was_stopped_goes_on_and_gives_the_same(experiment, tmp_path):
    path = experiment()
    _, whole = finished(path, tmp_path / "a")
    stopped = BenchmarkRun(path, tmp_path / "b").episodes()
    for _ in range(6):  # in the middle of a chain of the strict row
        next(stopped)
    stopped.close()
    with (tmp_path / "b" / EPISODES).open("ab") as file:
        file.write(b'{"torn":')
    records, files = finished(path, tmp_path / "b")
    assert files == whole
    assert len(records) < 12  # whole chains are not done again


def test_run_refuses_the_folder_of_another(experiment, tmp_path):
    finished(experiment(), tmp_path / "a")
    path = experiment(subsets=["base"])
    with pytest.raises(FileError, match="a run of something else"):
        BenchmarkRun(path, tmp_path / "a")
    assert BenchmarkRun(path, tmp_path / "a", fresh=True).total == 6


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"subsets": ["basic"]}, "no subset 'basic'"),
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
    assert "| expert | 3/4 |" in done.output
    wrong = CliRunner().invoke(app, ["eval", str(path), "--out", str(out), "--half-width", "0.1"])
    assert wrong.exit_code != 0
    assert "has no --half-width" in wrong.output


# ----------------------------------------------------------------- hosted


@pytest.fixture
def answering():
    """A server that opens the fridge first where it was told that it is shut."""

    def answer(path, body, headers):
        said = [message["content"] for message in body["messages"]]
        prompt = "\n".join(one if isinstance(one, str) else one[-1]["text"] for one in said)
        numbers = dict(reversed(one) for one in re.findall(r"^(\d+): (.+)$", prompt, re.MULTILINE))
        names = ["find a Apple", "pick up the Apple", "find a Fridge", PUT]
        if "putting it at" in prompt:
            names = ["find a Fridge", "open the Fridge", PUT]
        plan = [{"action_id": int(numbers[name]), "action_name": name} for name in names]
        said = {"role": "assistant", "content": json.dumps({"executable_plan": plan})}
        choice = {"index": 0, "message": said, "finish_reason": "stop"}
        usage = {"prompt_tokens": 9, "completion_tokens": 9, "total_tokens": 18}
        return 200, {}, json.dumps({"choices": [choice], "usage": usage}).encode()

    with wire_server(answer) as found:
        yield found


def test_hosted_run_is_recorded_and_replayed_to_the_byte(
    experiment, tmp_path, answering, monkeypatch
):
    plant_key(monkeypatch)
    url, seen = answering
    path = experiment(HOSTED.format(url=url), only=["base/0", "spatial/0"])
    tape = Cassette(tmp_path / "tape", "record")
    records, first = finished(path, tmp_path / "a", cassette=tape)
    assert [(record.success, record.calls) for record in records] == [(True, 2), (True, 2)]
    asked = len(seen)
    tape = Cassette(tmp_path / "tape", "replay")
    assert finished(path, tmp_path / "b", cassette=tape)[1] == first
    assert len(seen) == asked == 4


def test_hosted_run_with_pictures_sends_them_and_the_cassette_keeps_their_names(
    experiment, tmp_path, answering, monkeypatch
):
    plant_key(monkeypatch)
    url, seen = answering
    rows = HOSTED.format(url=url).replace("[models]", "prompt = { pictures = 1 }\n[models]", 1)
    path = experiment(rows, only=["base/0"])
    tape = Cassette(tmp_path / "tape", "record")
    records, first = finished(path, tmp_path / "a", cassette=tape)
    assert records[0].success
    picture = seen[0][1]["messages"][1]["content"][0]
    assert picture["image_url"]["url"].startswith("data:image/png;base64,")
    kept = (tmp_path / "tape" / "exchanges.jsonl").read_text()
    assert "500x500 " in kept
    assert "base64" not in kept
    tape = Cassette(tmp_path / "tape", "replay")
    assert finished(path, tmp_path / "b", cassette=tape)[1] == first


def test_hosted_run_with_workers_is_refused(experiment, tmp_path, answering, monkeypatch):
    plant_key(monkeypatch)
    path = experiment(HOSTED.format(url=answering[0]))
    with pytest.raises(KarmaError, match="one process only"):
        finished(path, tmp_path / "a", workers=2)
