"""Runs that are killed, shared among workers and gone on with: always the same bytes."""

import gzip
import json
import multiprocessing
import os
import re
import shutil
import signal
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.abuse import SAMPLE
from support.abuse.faults import until_free
from support.run_files import (
    ONLY,
    ROOT,
    TASKS,
    copy,
    files,
    lines_in,
    started,
    write_experiment,
)

from karma.bench.engine.run import Run
from karma.bench.figures.columns import added_up
from karma.errors import FileError, KarmaError
from karma.files import TEMPORARY
from karma.goals.goals import GoalTracker, WatchedWorld, parse_goal
from karma.journal.entries import Action, Ended, Enter, Instruction
from karma.journal.folder import EPISODES, HEADER, MARK, RESULTS, TIMINGS, locked
from karma.journal.header import FORMAT, Header
from karma.journal.records import EpisodeRecord, EpisodeTiming, SubTaskTiming, read_records
from karma.journal.run_folder import Finished, RunFolder, read_run
from karma.journal.steps import (
    read_steps,
    slug,
    steps_path,
)
from karma.seeds import stream
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld


@pytest.fixture(scope="module")
def whole(planner, tmp_path_factory):
    """An undisturbed run: (experiment, folder)."""
    folder = tmp_path_factory.mktemp("whole")
    path = write_experiment(folder / "x.toml", planner)
    assert len(list(Run(path, folder / "run").episodes())) == 12
    return path, folder / "run"


# ----------------------------------------------------------------- what is in the folder


def test_finished_run_is_in_the_order_of_seed_row_and_task(whole):
    _, folder = whole
    order = [
        (row, task, seed)
        for seed in (0, 1)
        for row in ("expert", "babble (K = 3)")
        for task in ONLY
    ]
    # the experiment's order of tasks is the task file's
    listed = [json.loads(line)["id"] for line in TASKS.read_text().splitlines()]
    order.sort(key=lambda key: (key[2], key[0] != "expert", listed.index(key[1])))
    data = read_run(folder)
    assert [record.key for record in data.records] == order
    assert {record.error for record in data.records} == {""}
    assert all(record.success for record in data.records if record.row == "expert")
    assert all(record.subtasks[0].answers for record in data.records if record.row != "expert")
    rooms = {record.scene for record in data.records}
    assert {path.stem for path in (folder / "maps").iterdir()} == rooms
    assert list(data.timings) == order
    assert all(timing.seconds > 0 for timing in data.timings.values())
    assert (data.folder, data.header.name, data.header.format) == (folder, "x", FORMAT)
    assert all(
        len(sub.answers) == len(taken.answers)
        for record in data.records
        for sub, taken in zip(record.subtasks, data.timings[record.key].subtasks, strict=True)
    )


def test_header_names_all_that_a_run_depends_on(whole):
    _, folder = whole
    header = json.loads((folder / HEADER).read_text())
    assert set(header["models"]) == {"planner", "embedder", "vision"}
    assert re.fullmatch(r"tiny [0-9a-f]{64}", header["models"]["planner"])
    assert set(header["prompts"]) == {p.name for p in (ROOT / "karma").rglob("*.txt")}
    scenes = {record.scene for record in read_run(folder).records}
    assert set(header["scenes"]) == scenes
    assert {"karma", "llama-cpp-python", "numpy", "python"} <= set(header["versions"])
    assert header["machine"]["cores"] >= 1
    hashes = [*header["prompts"].values(), *header["scenes"].values(), header["files"]["tasks"]]
    assert all(re.fullmatch("[0-9a-f]{64}", text) for text in hashes)


def test_results_hold_no_times(whole):
    _, folder = whole
    lines = json.loads((folder / RESULTS).read_text())
    timed = {"seconds", "first_token_s", "answer_s", "rt_clock"}
    assert not any(timed & line["values"].keys() for line in lines)
    assert all(line["values"]["success"]["low"] is not None for line in lines)
    assert sum(line["episodes"] for line in lines if line["kind"] == "all") == 12


def test_step_log_leads_the_world_through_the_episode_again(whole):
    """Whatever a log says of an action happens again, and the same goals are met at the end."""
    _, folder = whole
    replayed = 0
    for record in read_run(folder).records:
        start, *steps = read_steps(steps_path(folder, *record.key))
        assert start == Enter(scene=record.scene)
        world, tracker = EmbeddedWorld(), GoalTracker()
        world.reset(start.scene)
        watched, begun, ends = WatchedWorld(world, tracker), False, []
        for step in steps:
            if isinstance(step, Instruction):
                if not begun:
                    tracker.start(world.last_event)
                begun = True
                goals = tuple(map(parse_goal, record.subtasks[step.number].goals))
                asked = SubTask(instruction=step.instruction, goals=goals)
                tracker.begin_subtask(asked, world.last_event)
            elif isinstance(step, Action):
                event = watched.step(step.action, **step.arguments)
                assert bool(event) == step.ok, (record.key, step)
                assert step.ok or event.metadata["errorMessage"] == step.error
                replayed += 1
            elif isinstance(step, Ended):
                ends.append((step.finished, step.unmet))
        assert ends == [(sub.finished, sub.unmet) for sub in record.subtasks]
        logged = [sub.instruction for sub in steps if isinstance(sub, Instruction)]
        assert logged == [sub.instruction for sub in record.subtasks]
    assert replayed > 500


def test_step_logs_of_equal_runs_are_equal_files_without_a_time_of_day(whole):
    _, folder = whole
    (log, *_) = sorted(folder.glob("steps/*/*.gz"))
    assert log.read_bytes()[4:8] == bytes(4)
    lines = [json.loads(line) for line in gzip.decompress(log.read_bytes()).splitlines()]
    assert lines[0]["kind"] == "enter"
    assert {"subtask", "plan", "action", "skill", "outcome", "map"} == {
        line["kind"] for line in lines[1:]
    }


def test_step_logs_can_be_left_out_but_not_midway(planner, tmp_path):
    path = write_experiment(tmp_path / "x.toml", planner, only=ONLY[:1], more="")
    run = Run(path, tmp_path / "run", steps=False)
    assert len(list(run.episodes())) == 2
    assert not (tmp_path / "run" / "steps").exists()
    assert len(run.records) == 2
    with pytest.raises(FileError, match="step logs: False became True"):
        Run(path, tmp_path / "run", steps=True)


@given(one=st.text(min_size=1), other=st.text(min_size=1))
def test_slug_is_a_file_name_and_tells_texts_apart(one, other):
    assert re.fullmatch(r"[a-z0-9-]+", slug(one))
    assert (slug(one) == slug(other)) == (one == other)


def test_damaged_step_log_is_named(tmp_path):
    path = tmp_path / "x.jsonl.gz"
    with pytest.raises(FileError, match="No such file"):
        read_steps(path)
    path.write_bytes(b"no gzip")
    with pytest.raises(FileError, match=r"x\.jsonl\.gz: torn gzip"):
        read_steps(path)
    path.write_bytes(gzip.compress(b'{"kind":"enter","scene":"a"}\n{"kind":"jump"}\n'))
    with pytest.raises(FileError, match=r"line 2: .*jump"):
        read_steps(path)


# ----------------------------------------------------------------- going on


@pytest.mark.parametrize("kept", [3, 8])
def test_run_goes_on_to_the_same_bytes_wherever_it_was_cut(whole, tmp_path, kept):
    path, folder = whole
    cut = copy(folder, tmp_path / "cut")
    (cut / RESULTS).unlink()
    records = (cut / EPISODES).read_bytes().splitlines(keepends=True)
    timings = (cut / TIMINGS).read_bytes().splitlines(keepends=True)
    (cut / EPISODES).write_bytes(b"".join(records[:kept]) + records[kept][:99])
    (cut / TIMINGS).write_bytes(b"".join(timings[: kept + 1]))
    (cut / f".episodes.jsonl.a1b2c3d4{TEMPORARY}").write_bytes(b"torn")
    run = Run(path, cut)
    assert len(run.records) == kept
    assert len(list(run.episodes())) == 12 - kept
    assert files(cut) == files(folder)


def test_episode_whose_step_log_is_missing_is_done_again(whole, tmp_path):
    path, folder = whole
    cut = copy(folder, tmp_path / "cut")
    steps_path(cut, "expert", ONLY[1], 1).unlink()
    (again,) = Run(path, cut).episodes()
    assert again.key == ("expert", ONLY[1], 1)
    assert files(cut) == files(folder)


def test_reading_a_run_that_is_under_way_changes_nothing(whole, tmp_path):
    _, folder = whole
    cut = copy(folder, tmp_path / "cut")
    (cut / RESULTS).unlink()
    records = (cut / EPISODES).read_bytes().splitlines(keepends=True)
    (cut / EPISODES).write_bytes(b"".join(records[:4]) + records[4][:99])
    before = {path: path.read_bytes() for path in cut.rglob("*") if path.is_file()}
    assert len(read_run(cut).records) == 4
    assert {path: path.read_bytes() for path in cut.rglob("*") if path.is_file()} == before


def test_two_runs_at_once_in_one_folder_are_refused(whole, tmp_path):
    path, folder = whole
    cut = copy(folder, tmp_path / "cut")
    (cut / RESULTS).unlink()
    (cut / EPISODES).write_bytes(b"")
    first, second = Run(path, cut), Run(path, cut)
    going = first.episodes()
    next(going)
    with pytest.raises(KarmaError, match="another run is at work in this folder"):
        Run(path, cut)
    with pytest.raises(KarmaError, match="another run is at work in this folder"):
        next(second.episodes())
    going.close()
    assert next(second.episodes()).key != first.records[0].key


# ----------------------------------------------------------------- refusing to mix


def changed(text, path):
    """The experiment with something of it, or of what it names, changed."""
    if text == "task file":
        tasks = path.with_name("tasks.jsonl")
        tasks.write_text(TASKS.read_text().replace("candle", "red candle"))
        return path.read_text().replace(str(TASKS), str(tasks))
    if text == "weights":
        planner = re.search('planner = "(.*)"', path.read_text())[1]
        other = path.with_name("tiny.gguf")
        data = bytearray(Path(planner).read_bytes())
        data[-1] ^= 1
        other.write_bytes(data)
        return path.read_text().replace(planner, str(other))
    if text == "row":
        return path.read_text().replace("recall_k = 3", "recall_k = 4")
    return path.read_text().replace("seeds = [0, 1]", "seeds = [0, 1, 2]")


@pytest.mark.parametrize(
    ("what", "named"),
    [
        ("task file", r"files: tasks: [0-9a-f]{12} became [0-9a-f]{12}"),
        ("weights", r"models: planner: tiny [0-9a-f]{12} became tiny [0-9a-f]{12}"),
        ("row", r"row babble \(K = 3\): options\.recall_k: 3 became 4"),
        ("seeds", r"seeds: \[0,1\] became \[0,1,2\]"),
    ],
)
def test_changed_input_is_refused_by_name_and_with_the_fix(whole, tmp_path, what, named):
    path, folder = whole
    run, other = copy(folder, tmp_path / "run"), tmp_path / "x.toml"
    shutil.copy(path, other)
    other.write_text(changed(what, other))
    with pytest.raises(FileError, match=named) as caught:
        Run(other, run)
    assert f"{run / HEADER}: this folder holds a run of something else" in str(caught.value)
    assert f"--out another folder, or karma eval {other} --fresh, which sets" in str(caught.value)
    assert files(run) == files(folder)


def test_episodes_without_a_header_are_nobody_s_and_refused(whole, tmp_path):
    path, folder = whole
    run = copy(folder, tmp_path / "run")
    (run / HEADER).unlink()
    with pytest.raises(FileError, match=r"header\.json: this folder holds .*\n  header: none"):
        Run(path, run)
    assert (run / EPISODES).read_bytes() == (folder / EPISODES).read_bytes()


def header(**changes):
    return Header(
        **{"name": "x", "options": {"tasks": "a", "rows": []}, "files": {"tasks": "b" * 64},
           "versions": {"karma": "1"}, "models": {"planner": f"m {'c' * 64}"},
           "prompts": {"p": "d" * 64}, "scenes": {"kitchen_1": "e" * 64}, **changes}
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"versions": {"karma": "2"}}, "versions: karma: 1 became 2"),
        ({"prompts": {"p": "f" * 64}}, f"prompts: p: {'d' * 12} became {'f' * 12}"),
        ({"scenes": {}}, f"scenes: kitchen_1: {'e' * 12} became none"),
        ({"network": True}, "run: network: False became True"),
        ({"models": {"planner": "m"}}, f"models: planner: m {'c' * 12} became m"),
        ({"options": {"tasks": "c", "rows": []}}, 'tasks: "a" became "c"'),
    ],
)
def test_difference_of_two_headers_is_said_in_words(change, said):
    assert header().apart(header(**change)) == [said]
    assert header().apart(header()) == []


OLD = {
    "written by KARMA 0.3.0": {"format": 5, "versions": {"karma": "0.3.0"}},
    "written by an earlier KARMA": {"experiment": "a"},
}


@pytest.mark.parametrize("said", OLD)
def test_folder_of_an_earlier_version_is_refused_with_the_fix(planner, tmp_path, said):
    path, folder = write_experiment(tmp_path / "x.toml", planner), tmp_path / "run"
    folder.mkdir()
    (folder / HEADER).write_text(json.dumps(OLD[said]))
    (folder / MARK).write_text('{"kind":"run"}\n"episodes.jsonl"\n')  # as 0.3.0 wrote it
    for opened in (lambda: read_run(folder), lambda: Run(path, folder)):
        with pytest.raises(FileError, match=said) as caught:
            opened()
        assert str(folder) in str(caught.value)
        assert "To fix: read it with that version, or run the experiment" in str(caught.value)
    assert Run(path, folder, fresh=True).records == []
    with pytest.raises(FileError, match="there is no run in this folder"):
        read_run(tmp_path)


def test_header_that_the_run_did_not_write_is_refused_and_stays(whole, tmp_path):
    path, folder = whole
    run = copy(folder, tmp_path / "run")
    (run / HEADER).write_text('{"experiment": "mine"}')
    before = files(run)
    for fresh in (False, True):
        with pytest.raises(FileError, match="is not the header that this folder's run wrote"):
            Run(path, run, fresh=fresh)
    assert files(run) == before


# ----------------------------------------------------------------- killed at any byte


def finished(number):
    record = EpisodeRecord(
        row="r", task=f"t{number}", kind="simple", scene="s", seed=0, notes=(), subtasks=()
    )
    timing = EpisodeTiming(row="r", task=f"t{number}", seed=0, subtasks=(SubTaskTiming(seconds=1),))
    return Finished(record=record, timing=timing, steps=f"step {number}\n".encode())


ORDER = [("r", f"t{number}", 0) for number in range(4)]


def complete(folder, order=range(4)):
    """Do what is missing."""
    files = RunFolder(folder, steps=True)
    with locked(files.path):
        files.claim(header(), fix="")
        done = {record.key for record in files.done()[0]}
        for number in order:
            if ORDER[number] not in done:
                files.commit(finished(number))
        files.finish(ORDER, lambda records: {RESULTS: added_up(records)})


@settings(max_examples=30)
@given(
    order=st.permutations(range(4)),
    whole_episodes=st.integers(0, 3),
    stage=st.sampled_from(["steps", "timings", "episodes"]),
    cut=st.integers(0, 400),
)
def test_run_killed_at_any_byte_ends_in_the_same_bytes(
    tmp_path_factory, order, whole_episodes, stage, cut
):
    base = tmp_path_factory.mktemp("kill")
    complete(base / "whole")
    folder = base / "killed"
    folder.mkdir()
    run = RunFolder(folder, steps=True)
    run.claim(header(), fix="")
    for number in order[:whole_episodes]:
        run.commit(finished(number))
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    run.commit(finished(order[whole_episodes]))
    # take back what a process that died in that stage would not have written
    record, timing = folder / EPISODES, folder / TIMINGS
    for path, torn_at in ((record, "episodes"), (timing, "timings")):
        old, new = before.get(path, b""), path.read_bytes()
        later = torn_at == "episodes" or stage == "steps"
        if torn_at == stage:
            path.write_bytes(new[: len(old) + cut % (len(new) - len(old))])
        elif later:
            path.write_bytes(old)
    if stage == "steps":
        log = steps_path(folder, *ORDER[order[whole_episodes]])
        log.rename(log.with_name(f".{log.name}.0a1b2c3d{TEMPORARY}"))
    complete(folder, order)
    assert files(folder) == files(base / "whole")


# ----------------------------------------------------------------- killed for real


@pytest.mark.parametrize("workers", [1, 2] if SAMPLE else [1])
def test_run_killed_many_times_ends_in_the_same_bytes(whole, tmp_path, workers):
    """$KARMA_SAMPLE kills, and then a run of 100 episodes of the shipped planner; else five."""
    path, folder = whole
    if SAMPLE:
        only = [json.loads(line)["id"] for line in TASKS.read_text().splitlines()[:25]]
        path, folder = (
            write_experiment(tmp_path / "x.toml", "karma-nano", only=only),
            tmp_path / "1",
        )
        assert len(list(Run(path, folder).episodes())) == 100
    killed, rng, kills = tmp_path / "killed", stream(5, "kills"), 0
    episodes = lines_in(folder / EPISODES)
    for wanted in sorted(int(n) for n in rng.integers(0, episodes, SAMPLE or 5)):
        process = started(path, killed, workers=workers)
        while process.is_alive() and lines_in(killed / EPISODES) < wanted:
            time.sleep(0.002)
        process.join(float(rng.uniform(0, 0.5)))
        kills += process.is_alive()
        process.kill()
        process.join()
        until_free(killed)
    assert kills > 0
    process = started(path, killed, workers=workers)
    process.join()
    assert process.exitcode == 0
    assert files(killed) == files(folder)
    print(
        f"{workers} workers: {kills} kills met a living run, {len(files(killed))} files are equal"
    )


def test_full_disk_ends_the_run_and_counts_as_nobody_s_failure(whole, tmp_path):
    """No file may grow beyond 8,000 bytes: records and maps of rooms do."""
    path, folder = whole
    full = tmp_path / "full"
    process = started(path, full, most_bytes=8_000)
    process.join()
    assert process.exitcode == 1
    kept = read_run(full)
    assert not kept.finished
    assert 0 < len(kept.records) < 12
    assert kept.records == read_run(folder).records[: len(kept.records)]
    assert len(list(Run(path, full).episodes())) == 12 - len(kept.records)
    assert files(full) == files(folder)


def test_interrupted_run_says_how_to_go_on(whole, tmp_path):
    path, folder = whole
    stopped = tmp_path / "stopped"
    process = started(path, stopped)
    while process.is_alive() and lines_in(stopped / EPISODES) < 2:
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGINT)
    process.join()
    assert process.exitcode == 130
    kept = read_records(stopped / EPISODES)
    assert 2 <= len(kept) < 12
    assert kept == list(read_run(folder).records[: len(kept)])
    assert not (stopped / RESULTS).exists()
    assert len(Run(path, stopped).records) == len(kept)


def test_two_workers_leave_the_same_bytes_as_one(whole, tmp_path):
    path, folder = whole
    run = Run(path, tmp_path / "run")
    records = list(run.episodes(workers=2))
    assert {record.key for record in records} == {r.key for r in read_run(folder).records}
    assert files(tmp_path / "run") == files(folder)
    assert multiprocessing.active_children() == []
