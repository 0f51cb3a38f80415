"""EB-ALFRED played by hosted models: recorded, replayed, by several workers, cut short."""

import json
import os
import re
import signal
import threading
import time

import pytest
from support.eb_alfred import run_files
from support.hosted_server import plant_key, wire_server
from support.run_files import lines_in, started
from typer.testing import CliRunner

from karma.bench.run import Run
from karma.cli import app
from karma.errors import KarmaError
from karma.infer.hosted.cassette import FILE, Cassette
from karma.journal.header import EPISODES, TABLE
from karma.world.eb_alfred.actions import PUT

IN_FLIGHT = 4
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


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


def finished(path, folder, workers=1, **more):
    run = Run(path, folder, **more)
    return list(run.episodes(workers)), run_files(folder)


def eight_tasks():
    return {"base": [("ours_1", f"Put the apple into the fridge, please ({n}).") for n in range(8)]}


def household(path, body, headers):
    """Answers with a plan that opens the fridge first where it was told that it is shut."""
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


@pytest.fixture
def answering():
    with wire_server(household) as found:
        yield found


def test_hosted_run_is_recorded_and_replayed_to_the_byte(experiment, tmp_path, answering):
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
    experiment, tmp_path, answering
):
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


def test_hosted_run_with_four_workers_has_four_requests_in_flight_and_the_same_bytes(
    experiment, tmp_path
):
    together, asked = threading.Barrier(IN_FLIGHT), []

    def answer(path, body, headers):
        asked.append(path)
        if len(asked) <= IN_FLIGHT:
            together.wait(120)  # so many at once, or the run fails
        return household(path, body, headers)

    tape = tmp_path / "tape"
    with wire_server(answer) as (url, _):
        path = experiment(HOSTED.format(url=url), tasks=eight_tasks())
        _, four = finished(path, tmp_path / "four", IN_FLIGHT, cassette=Cassette(tape, "record"))
    recorded = (tape / FILE).read_bytes()
    with wire_server(household) as (url, _):
        records, one = finished(path, tmp_path / "one", base_url=url)
    assert [record.success for record in records] == [True] * 8
    assert one == four
    for number in (1, 3):
        found = finished(path, tmp_path / f"{number}", number, cassette=Cassette(tape, "replay"))
        assert found[1] == four
    assert (tape / FILE).read_bytes() == recorded


def test_hosted_run_that_is_killed_with_workers_at_work_goes_on_to_the_same_bytes(
    experiment, tmp_path
):
    slow = threading.Event()

    def answer(path, body, headers):
        if "(6)" in json.dumps(body) or "(7)" in json.dumps(body):
            slow.wait(60)  # two episodes that are in flight when the run is killed
        return household(path, body, headers)

    out = tmp_path / "killed"
    with wire_server(answer) as (url, _):
        path = experiment(HOSTED.format(url=url), tasks=eight_tasks())
        process = started(path, out, workers=3)
        while lines_in(out / EPISODES) < 3 and process.is_alive():
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        slow.set()
        done = set((out / EPISODES).read_bytes().splitlines())
        assert 0 < len(done) < 8
        records, files = finished(path, out, workers=2)
        assert len(records) < 8
        assert done <= set((out / EPISODES).read_bytes().splitlines())
        assert files == finished(path, tmp_path / "calm")[1]


def test_hosted_run_whose_server_is_lost_ends_by_name_and_goes_on(experiment, tmp_path):
    with wire_server(household) as (url, _):
        path = experiment(HOSTED.format(url=url) + "retries = 0\n", tasks=eight_tasks())
        first = Run(path, tmp_path / "a").episodes()
        next(first)
        first.close()
    with pytest.raises(KarmaError, match="see that a server answers at"):
        finished(path, tmp_path / "a", workers=2)
    assert lines_in(tmp_path / "a" / EPISODES) == 1  # what was not asked is no failed episode
    with wire_server(household) as (url, _):
        records, _ = finished(path, tmp_path / "a", base_url=url)
    assert len(records) == 7


def test_table_has_rows_of_several_runs_and_the_published_ones(experiment, tmp_path, answering):
    rows = "".join(f'[[rows]]\nname = "{one}"\nplayer = "{one}"\n' for one in ("expert", "chance"))
    finished(experiment(rows), tmp_path / "ours")
    path = experiment(HOSTED.format(url=answering[0]), only=["base/0", "spatial/0"])
    tape = Cassette(tmp_path / "tape", "record")
    finished(path, tmp_path / "recorded", cassette=tape)
    finished(path, tmp_path / "replayed", cassette=Cassette(tmp_path / "tape", "replay"))
    out = tmp_path / "table"
    command = ["table", str(tmp_path / "ours"), "--out", str(out), "--beside"]
    done = CliRunner().invoke(app, [*command, str(tmp_path / "replayed")])
    assert done.exit_code == 0, done.output
    table = (out / TABLE).read_text()
    for row in ("| **expert** | 100.0 |", "| **chance** |", "| Deep Thought | 42.0 |"):
        assert row in table
    assert "| **hosted** (2 tasks) | 100.0 |" in table
    twice = CliRunner().invoke(app, [*command, str(tmp_path / "ours")])
    assert "row 'chance' is in another of these runs" in " ".join(twice.output.split())


def test_table_refuses_runs_of_other_tasks(experiment, tmp_path, answering):
    rows = '[[rows]]\nname = "expert"\nplayer = "expert"\n'
    finished(experiment(rows), tmp_path / "ours")
    path = experiment(HOSTED.format(url=answering[0]), tasks={"base": [("ours_1", "Cool it.")]})
    finished(path, tmp_path / "other")
    command = ["table", str(tmp_path / "ours"), "--beside", str(tmp_path / "other")]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1
    assert "its tasks or prompts are not those of" in " ".join(done.output.split())
