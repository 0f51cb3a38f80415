"""Hosted runs with many requests in flight: recorded, replayed, throttled, and left alone."""

import json
import os
import re
import subprocess
import sys
import threading
from collections import Counter

import pytest
from support.hosted_server import (
    free_port,
    household,
    need_loopback,
    plant_key,
    wire_server,
)
from support.paths import ROOT
from support.run_files import karma, write_experiment

from karma.bench.engine.run import Run
from karma.errors import KarmaError
from karma.journal.records import read_records
from karma.plugins.hosted.cassette import FILE, Cassette

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
ONLY = [
    "simple-14", "simple-15", "composite-13", "composite-14", "composite-15", "complex-16",
    "complex-17", "complex-18",
]  # fmt: skip
CANDLE = "composite-15"
IN_FLIGHT = 4
SERVED = """
import os, signal, sys, time
from support.hosted_server import household, wire_server
port, most = map(int, sys.argv[1:])
asked = []
def answer(path, body, headers):
    asked.append(path)
    if len(asked) == most:
        os.kill(os.getpid(), signal.SIGKILL)
    return household(path, body, headers)
with wire_server(answer, port=port):
    print("ready", flush=True)
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


@pytest.fixture
def experiment(tmp_path):
    """A function that writes an experiment of eight episodes or fewer, all models hosted."""

    def write(url, only=tuple(ONLY), **fields):
        path = tmp_path / "x.toml"
        place = f'base_url = "{url}"\nmodel = "m"\n'
        place += "".join(f"{name} = {value}\n" for name, value in fields.items())
        path.write_text(
            f'name = "x"\ntasks = "{TASKS}"\nonly = {[*only]}\n'
            '[[rows]]\nname = "hosted"\n'
            '[models]\nplanner = "openai"\nprofile = "compact"\nembedder = "openai"\n'
            'constraint = "free"\n'
            f"[models.hosted.planner]\n{place}[models.hosted.embedder]\n{place}"
        )
        return path

    return write


def whole(folder):
    """Every byte that a run has left, seconds too."""
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_episodes_recorded_by_several_workers_replay_byte_for_byte_by_any_number(
    experiment, tmp_path
):
    together, planning = threading.Barrier(IN_FLIGHT), Counter()

    def answer(path, body, headers):
        planning[path] += 1
        if path.endswith("/chat/completions") and planning[path] <= IN_FLIGHT:
            together.wait(120)  # so many are in flight at once, or the run fails
        return household(path, body, headers)

    tape = tmp_path / "tape"
    with wire_server(answer) as (url, _):
        path = experiment(url, retries=0)
        list(Run(path, tmp_path / "run", cassette=Cassette(tape, "record")).episodes(IN_FLIGHT))
    before, recorded = (tape / FILE).read_bytes(), whole(tmp_path / "run")
    records = read_records(tmp_path / "run" / "episodes.jsonl")
    assert [record.error for record in records] == [""] * 8
    assert {one.role for record in records for one in record.spent()} == {"planner", "embedder"}
    for number in (1, 3):
        again = tmp_path / f"again-{number}"
        run = Run(path, again, cassette=Cassette(tape, "replay"))
        list(run.episodes(number))
        assert whole(again) == recorded
    assert (tape / FILE).read_bytes() == before


def test_refused_requests_are_asked_again_and_the_records_are_those_of_a_calm_server(
    experiment, tmp_path
):

    def busy(path, body, headers):
        first = headers["x-stainless-retry-count"] == "0"
        return (429, {"retry-after-ms": "1"}, b"{}") if first else household(path, body, headers)

    for name, answer, workers in (("busy", busy, 3), ("calm", household, 1)):
        with wire_server(answer) as (url, seen):
            path = experiment("http://127.0.0.1:9/v1", retries=1)
            list(Run(path, tmp_path / name, base_url=url).episodes(workers))
        refused = [one for _, _, one in seen if one["x-stainless-retry-count"] == "1"]
        assert len(refused) == (len(seen) / 2 if name == "busy" else 0)
    assert programs(tmp_path / "busy") == programs(tmp_path / "calm")


def programs(folder):
    """Records without the bill: which episode pays for an embedding depends on who comes first."""
    lines = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    for line in lines:
        del line["hosted"]
        for part in line["subtasks"]:
            del part["hosted"]
    return lines


def served(port, most):
    """A server in a process of its own, which is killed by SIGKILL at its `most`-th request."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    process = subprocess.Popen(
        [sys.executable, "-c", SERVED, str(port), str(most)],
        env=environment, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout.readline() == "ready\n"
    return process


def test_server_killed_in_the_middle_ends_the_run_by_name_and_the_same_command_goes_on(
    experiment, tmp_path
):
    need_loopback()
    port = free_port()
    path = experiment(f"http://127.0.0.1:{port}/v1", retries=0)
    tape, out = tmp_path / "tape", tmp_path / "run"
    command = ("eval", path, "--out", out, "--workers", 3, "--cassette", tape,
               "--cassette-mode", "record")  # fmt: skip
    server = served(port, most=100)
    said = " ".join(karma(*command, code=1).split())
    assert server.wait(20) == -9
    assert "m at 127.0.0.1: Connection error" in said
    assert f"see that a server answers at http://127.0.0.1:{port}/v1" in said
    assert "not run, in no rate" in said
    assert "the same command does" in said
    kept = (out / "episodes.jsonl").read_bytes().splitlines()
    assert 0 < len(kept) < 8
    server = served(port, most=-1)
    try:
        karma(*command)
        list(Run(path, tmp_path / "calm").episodes(2))
    finally:
        server.kill()
        server.wait()
    assert set(kept) <= set((out / "episodes.jsonl").read_bytes().splitlines())
    assert programs(out) == programs(tmp_path / "calm")
    replayed = tmp_path / "replayed"
    list(Run(path, replayed, cassette=Cassette(tape, "replay")).episodes())
    assert whole(replayed) == whole(out)


def test_what_a_server_says_nothing_to_in_time_is_not_run_and_is_done_with_more_time(
    experiment, tmp_path
):
    over = threading.Event()

    def slow(path, body, headers):
        if "candle" in json.dumps(body):
            over.wait(60)
        return household(path, body, headers)

    with wire_server(slow) as (url, _):
        run = Run(experiment(url, retries=0, timeout_s=2.0), tmp_path / "run")
        assert len(list(run.episodes(2))) + len(run.not_run) == 8
        assert run.not_run
        for one in run.not_run:
            assert re.search(r"timed out.* \(asked 1 times, 2 s each at most\)", one.reason)
        over.set()
        path = experiment(url, retries=0, timeout_s=100.0)
        run = Run(path, tmp_path / "run")
        assert run.left > 0
        list(run.episodes(2))
    assert [record.error for record in run.records] == [""] * 8


def test_refusal_of_a_request_is_the_episode_s_failure_with_several_workers_too(
    experiment, tmp_path
):
    def picky(path, body, headers):
        if "candle on the toilet" in json.dumps(body):
            return 400, {}, b'{"error": {"message": "no candles"}}'
        return household(path, body, headers)

    with wire_server(picky) as (url, _):
        run = Run(experiment(url), tmp_path / "run")
        list(run.episodes(2))
    (failed,) = (record for record in run.records if record.error)
    assert failed.task == CANDLE
    assert "HTTP 400" in failed.error
    assert "no candles" in failed.error


def test_replay_by_several_workers_of_what_was_not_recorded_ends_the_run(experiment, tmp_path):
    tape = tmp_path / "tape"
    with wire_server(household) as (url, _):
        path = experiment(url)
        next(Run(path, tmp_path / "run", cassette=Cassette(tape, "record")).episodes())
    run = Run(path, tmp_path / "again", cassette=Cassette(tape, "replay"))
    with pytest.raises(KarmaError, match=r"exchanges\.jsonl: "):
        list(run.episodes(2))
    assert len(read_records(tmp_path / "again" / "episodes.jsonl")) <= 1


FAULTS = (  # one of each kind; tests/plugins/hosted/test_hosted.py has all dresses
    (200, b'{"error": {"message": "engine is dead", "type": "server_error"}}', "engine is dead"),
    (425, b'{"detail": "too early in the day"}', "too early in the day"),
    (522, b"<html><title>Connection timed out</title></html>", "522"),
)


@pytest.mark.parametrize(("status", "body", "words"), FAULTS, ids=lambda one: str(one)[:20])
def test_fault_of_a_server_is_in_no_rate_told_and_done_again(
    experiment, tmp_path, status, body, words
):
    ill = [True]

    def answer(path, asked, headers):
        sick = ill[0] and "candle on the toilet" in json.dumps(asked)
        return (status, {}, body) if sick else household(path, asked, headers)

    with wire_server(answer) as (url, _):
        path = experiment(url, only=(CANDLE, ONLY[0]), retries=0)
        command = ("eval", path, "--out", tmp_path / "run", "--workers", 1)
        said = karma(*command, code=1)
        assert "1 not run, in no rate (hosted 1); the same command does it again" in said
        assert words in said and f"hosted/{CANDLE}/0" in said
        kept = read_records(tmp_path / "run/episodes.jsonl")
        assert len(kept) == 1 and CANDLE not in {record.task for record in kept}
        assert words in karma("table", tmp_path / "run")
        assert not (tmp_path / "run/results.json").exists()
        ill[0] = False
        assert "not run" not in karma(*command)
    assert len(read_records(tmp_path / "run/episodes.jsonl")) == 2
    assert "not run" not in karma("table", tmp_path / "run")
    assert not (tmp_path / "run/not_run.jsonl").exists()


def test_run_ends_where_several_episodes_in_a_row_were_not_run(experiment, tmp_path):
    with wire_server(lambda *_: (503, {}, b'{"error": {"message": "all gone"}}')) as (url, _):
        run = Run(experiment(url, retries=0), tmp_path / "run")
        with pytest.raises(KarmaError, match=r"3 episodes one after the other .*all gone"):
            list(run.episodes())
    assert [one.task for one in run.not_run] == ONLY[:3]
    assert run.left == 8


HOSTED = """
[models.hosted.planner]
base_url = "http://127.0.0.1:9/v1"
model = "m"
"""


def test_what_is_not_for_a_cluster_is_refused_by_name(planner, tmp_path):
    path = write_experiment(tmp_path / "x.toml", "openai")
    path.write_text(path.read_text() + HOSTED)
    hosted = Run(path, tmp_path / "hosted")
    path = write_experiment(tmp_path / "y.toml", planner)
    recorded = Run(path, tmp_path / "tape-run", cassette=Cassette(tmp_path / "tape", "record"))
    for run in (hosted, recorded):
        with pytest.raises(KarmaError, match=r"for workers on this machine\n  To fix: --workers"):
            next(run.episodes(ray="127.0.0.1:1"))
