"""Two arms over the same tasks and seeds: pairs, differences, refusals, and the command."""

import json
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.made_records import answer, episode, plain, sub, write_run
from support.paths import ROOT
from support.run_files import karma

from karma.bench.figures.compare import Arm, compare
from karma.bench.figures.metrics import episodes_of
from karma.errors import KarmaError
from karma.journal.records import EpisodeTiming, SubTaskTiming


def arm(name, records, timings=None):
    return Arm(name=name, episodes=episodes_of(records, timings))


def outcomes(rows, **common):
    """Return episodes from task -> outcomes by seed."""
    return [
        plain(solved == "+", task=task, seed=seed, **common)
        for task, seeds in rows.items()
        for seed, solved in enumerate(seeds)
    ]


def line(comparison, key):
    return next(one for one in comparison.lines if one.key == key)


# ----------------------------------------------------------------- what is said


def test_comparison_says_which_tasks_only_one_solved():
    found = compare(
        arm("A", outcomes({"t1": "++", "t2": "+-", "t3": "--"})),
        arm("B", outcomes({"t1": "++", "t2": "-+", "t3": "+-"})),
    )
    assert (found.pairs, found.tasks, found.seeds) == (6, 3, (0, 1))
    assert [(one.task, one.seeds) for one in found.only_first] == [("t2", (0,))]
    assert [(one.task, one.seeds) for one in found.only_second] == [("t2", (1,)), ("t3", (0,))]
    assert line(found, "success").difference.value == pytest.approx(-1 / 6)
    assert found.ratio.value == pytest.approx(3 / 4)
    assert (found.p, found.p_tasks) == (1.0, 1.0)


def test_comparison_keeps_a_task_s_seeds_together():
    """Five seeds of six tasks, always won: thirty pairs for McNemar, six tasks in truth."""
    tasks = [f"t{number}" for number in range(6)]
    found = compare(
        arm("A", outcomes(dict.fromkeys(tasks, "+++++"))),
        arm("B", outcomes(dict.fromkeys(tasks, "-----"))),
    )
    assert found.p == 2 / 2**30
    assert found.p_tasks == 2 / 2**6


def test_comparison_puts_tokens_and_seconds_side_by_side():
    def record(tokens, program):
        said = answer(program, prompt_tokens=tokens)
        return episode(sub("HOLDON(robot, Apple): 1", answers=[said]), sub("OPEN(Fridge): 1"))

    def timing(seconds):
        one = EpisodeTiming(
            row="KARMA", task="t1", seed=0, subtasks=(SubTaskTiming(seconds=seconds),)
        )
        return {one.key: one}

    found = compare(arm("A", [record(100, "x")], timing(1.0)), arm("B", [record(40, "y")]))
    tokens = line(found, "prompt_tokens")
    assert (tokens.first.value, tokens.second.value, tokens.difference.value) == (200, 140, 60)
    seconds = line(found, "seconds")
    assert (seconds.first.value, seconds.second.value, seconds.difference.value) == (1, None, None)


@settings(max_examples=10)
@given(rows=st.lists(st.tuples(st.booleans(), st.integers(0, 20)), min_size=2, max_size=20))
def test_identical_arms_differ_in_nothing(rows):
    records = [
        plain(solved, places=places, task=f"t{number}")
        for number, (solved, places) in enumerate(rows)
    ]
    found = compare(arm("A", records), arm("B", records))
    assert (found.p, found.p_tasks) == (1.0, 1.0)
    assert (found.only_first, found.only_second) == ((), ())
    for one in found.lines:
        if one.difference.value is not None:
            assert one.difference.value == 0
            assert one.difference.interval is None  # the same in every task


@settings(max_examples=10)
@given(gains=st.lists(st.integers(3, 5), min_size=8, max_size=20))
def test_a_known_difference_is_recovered(gains):
    first = [plain(True, places=10 + gain, task=f"t{n}") for n, gain in enumerate(gains)]
    second = [plain(True, places=10, task=f"t{n}") for n, _ in enumerate(gains)]
    found = line(compare(arm("A", first), arm("B", second)), "explorations").difference
    assert found.value == pytest.approx(sum(gains) / len(gains))
    assert (found.interval is None) == (len(set(gains)) == 1)
    if found.interval is not None:
        assert 3 <= found.interval.low <= found.interval.high <= 5


# ----------------------------------------------------------------- what is refused


def test_runs_over_different_tasks_are_refused_with_their_names():
    with pytest.raises(KarmaError, match="different tasks") as caught:
        compare(
            arm("A", outcomes({"t1": "+", "t2": "+"})), arm("B", outcomes({"t1": "+", "t3": "-"}))
        )
    assert "only A has t2" in str(caught.value)
    assert "only B has t3" in str(caught.value)
    assert "karma eval" in str(caught.value)


@pytest.mark.parametrize("changed", [{"scene": "kitchen_2"}, {"kind": "complex"}, {"goal": "OPEN"}])
def test_tasks_of_one_name_that_ask_something_else_are_refused(changed):
    from dataclasses import replace

    first = plain(True)
    if "goal" in changed:
        second = replace(first, subtasks=(sub("OPEN(Fridge): 1"),))
    else:
        second = replace(first, **changed)
    with pytest.raises(KarmaError, match="task t1 asks"):
        compare(arm("A", [first]), arm("B", [second]))


# ----------------------------------------------------------------- the command


@pytest.fixture
def folders(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    rows = {f"t{number}": "++" for number in range(8)}
    worse = {f"t{number}": "+-" if number < 4 else "--" for number in range(8)}
    both = [*outcomes(rows, row="KARMA"), *outcomes(worse, row="memory off")]
    write_run(tmp_path / "local", both)
    write_run(tmp_path / "hosted", [*outcomes(worse), *outcomes(worse, row="memory off")])
    write_run(tmp_path / "other", outcomes({"t9": "+"}))
    write_run(tmp_path / "empty", [])
    return tmp_path


def test_compare_command_sets_rows_of_one_name_side_by_side(folders):
    text = karma("compare", folders / "local", folders / "hosted", "--json", folders / "x.json")
    found = json.loads((folders / "x.json").read_text())
    assert [one["kind"] for one in found] == ["simple", "simple"]
    assert found[0]["first"].endswith("local:KARMA")
    assert found[1]["second"].endswith("hosted:memory off")
    first = next(one for one in found[0]["lines"] if one["key"] == "success")
    assert first["difference"]["value"] == 0.75
    for word in ("McNemar", "16 pairs", "8 tasks", "seeds 0, 1", "+0.75 [", "t0 (seed 1)"):
        assert word in text


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("local",), "it takes two"),
        (("local", "other:KARMA"), "which row"),
        (("local:KARMA", "other"), "different tasks"),
        (("local:nobody", "hosted:KARMA"), "no row 'nobody'; there are 'KARMA', 'memory off'"),
        (("local", "nowhere"), "no run in this folder"),
        (("local", "empty"), "no episodes yet"),
    ],
)
def test_compare_command_refuses_what_it_cannot_compare(folders, names, words):
    text = karma("compare", *(folders / name for name in names), code=1)
    assert words in text
    assert "karma " in text.split("To fix: ")[1]
    assert "Traceback" not in text


def test_compare_command_names_what_sets_the_runs_apart_and_refuses_other_rooms(tmp_path):
    for name, model, room in (("a", "nano 12", "1"), ("b", "gpt", "1"), ("c", "gpt", "2")):
        write_run(
            tmp_path / name, outcomes({"t1": "+"}), models={"planner": model},
            scenes={"kitchen_1": room * 64},
        )  # fmt: skip
    text = karma("compare", tmp_path / "a", tmp_path / "b")
    assert "models: planner: nano 12 became gpt" in text
    refused = karma("compare", tmp_path / "a", tmp_path / "c", code=1)
    assert "kitchen_1 is not the same room" in refused
    assert "To fix: karma eval" in refused


# ----------------------------------------------------------------- what the clock cut off


def asked(program, finish="stop", **said):
    return episode(sub("HOLDON(robot, Apple): 1", answers=[answer(program, finish=finish)]), **said)


def test_equal_runs_are_equal_save_for_what_the_clock_cut(tmp_path):
    def told(*pairs):
        folders = [tmp_path / f"{len(list(tmp_path.iterdir()))}{side}" for side in "ab"]
        for folder, records in zip(folders, zip(*pairs, strict=True), strict=True):
            write_run(folder, records)
        command = [sys.executable, str(ROOT / "scripts/compare_runs.py"), *map(str, folders)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout.splitlines()[-1]

    same, cut = (asked("x"), asked("x")), (asked("y", task="t2"), asked("y m", "time", task="t2"))
    assert told(same, cut) == (0, "1 episodes, 0 differ, 1 left out, cut off by the clock")
    differs = (asked("z", task="t3"), asked("other", task="t3"))
    assert told(same, differs) == (1, "2 episodes, 1 differ")
