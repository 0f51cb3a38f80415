"""Experiments, their records on disk, and what the records add up to."""

from dataclasses import replace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.made_records import answer, call, sub
from support.paths import ROOT

from karma.bench.engine.run import Run
from karma.bench.figures.columns import figures
from karma.errors import FileError, KarmaError
from karma.files import decode_json, to_json
from karma.journal.records import (
    AnswerTiming,
    EpisodeRecord,
    EpisodeTiming,
    SubTaskTiming,
    read_records,
    spent_by,
    untimed,
    waited,
)
from karma.models.session import Spent

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"


CALL = call("OpenObject(robot, 'Fridge')", actions=3, explorations=1)


def part(**changes):
    usual = sub("OPEN(Fridge): 1", instruction="Öffne den Kühlschrank.", calls=[CALL],
                recalled=["Mug|1"], queries=2, hits=1)  # fmt: skip
    return replace(usual, **changes)


def episode(**changes):
    return EpisodeRecord(
        **{"row": "KARMA", "task": "t1", "kind": "simple", "scene": "kitchen_1", "seed": 0,
           "notes": ("unresolved X: y",), "subtasks": (part(), part()), **changes}
    )  # fmt: skip


def timing(record, seconds=1.5):
    """1.5 s for each instruction."""
    parts = tuple(
        SubTaskTiming(
            seconds=seconds,
            answers=(AnswerTiming(first_token_s=0.25, total_s=0.5, reused_tokens=4),),
            hosted_s=tuple(2.0 for _ in sub.hosted),
        )
        for sub in record.subtasks
    )
    return EpisodeTiming(row=record.row, task=record.task, seed=record.seed, subtasks=parts)


def timings(*records):
    return {record.key: timing(record) for record in records}


FAILED = episode(task="t2", subtasks=(part(unmet=("OPEN(Fridge): 1",), hits=0, queries=1),))
BROKEN = episode(task="t3", kind="complex", subtasks=(part(queries=0, hits=0),), error="broke")
SILENT = episode(
    row="expert",
    subtasks=(part(answers=(), hits=0, calls=(CALL, msgspec.structs.replace(CALL, actions=5))),),
)


# ----------------------------------------------------------------- records on disk


@given(text=st.text(), other=st.text(), seconds=st.floats(0, 1e6))
def test_record_of_any_text_survives_a_round_trip_in_one_line(text, other, seconds):
    said = part(instruction=text, answers=(answer(program=other),))
    record = episode(subtasks=(said,), error=other)
    for one, kind in ((record, EpisodeRecord), (timing(record, seconds), EpisodeTiming)):
        line = to_json(one)
        assert line.count(b"\n") == 1
        assert decode_json(line, kind, path="x") == one


def test_record_holds_nothing_that_two_equal_runs_do_not_share():
    words = to_json(episode(subtasks=(part(hosted=untimed([SPENT])),))).decode()
    for word in ("first_token_s", "total_s", "reused_tokens", "threads", "batch", "2.5"):
        assert word not in words
    assert '"seconds":null' in words


SPENT = Spent(
    role="planner", model="m", requests=2, failures=0, prompt_tokens=9, completion_tokens=5,
    cost=0.5, seconds=2.5,
)  # fmt: skip


def test_costs_and_their_seconds_come_together_again():
    record = episode(
        subtasks=(part(hosted=untimed([SPENT])), part()), hosted=untimed([SPENT, SPENT])
    )
    assert spent_by(record, None) == untimed([SPENT, SPENT, SPENT])
    first = SubTaskTiming(seconds=1.0, hosted_s=waited([SPENT]))
    taken = replace(
        timing(record), subtasks=(first, SubTaskTiming(seconds=1.0)), hosted_s=(3.0, 4.0)
    )
    assert [one.seconds for one in spent_by(record, taken)] == [2.5, 3.0, 4.0]
    assert replace(spent_by(record, taken)[0], seconds=2.5) == SPENT


def test_damaged_line_before_the_last_is_refused_with_its_number(tmp_path):
    path = tmp_path / "episodes.jsonl"
    path.write_bytes(to_json(episode()) + b'{"row": 1}\n' + to_json(FAILED))
    with pytest.raises(FileError, match=r"episodes\.jsonl: line 2: .*\n.*take line 2 out"):
        read_records(path)


# ----------------------------------------------------------------- figures


def test_figures_equal_those_computed_by_hand():
    records = [episode(), FAILED, BROKEN, SILENT]
    lines = figures(records, timings(*records))
    assert [(line.row, line.kind) for line in lines] == [
        ("KARMA", "simple"), ("KARMA", "complex"), ("KARMA", "all"),
        ("expert", "simple"), ("expert", "all"),
    ]  # fmt: skip
    found = [{key: one.value for key, one in line.values.items()} for line in lines]
    assert [(line.successes, line.episodes) for line in lines] == [
        (1, 2), (0, 1), (1, 3), (1, 1), (1, 1),
    ]  # fmt: skip
    simple, broken, every, _, expert = found
    assert (simple["explorations"], simple["actions"]) == (1.5, 4.5)  # 3 calls in 2 episodes
    assert (simple["planner_calls"], simple["seconds"]) == (1.5, 2.25)
    assert simple["hits"] == every["hits"] == pytest.approx(2 / 5)
    assert (broken["success"], broken["hits"]) == (0.0, None)
    assert every["success"] == pytest.approx(1 / 3)
    assert (expert["success"], expert["actions"], expert["explorations"]) == (1.0, 8.0, 2.0)
    assert (expert["planner_calls"], expert["hits"]) == (None, None)
    assert figures([]) == ()


# ----------------------------------------------------------------- runs


@pytest.fixture
def experiment(tmp_path, planner):
    """A function that writes an experiment and returns its path."""

    def write(*rows, only=("simple-12",), more="", name="x"):
        rows = rows or ('name = "expert"\nmethod = "expert"',)
        path = tmp_path / f"{name}.toml"
        path.write_text(
            f'name = "{name}"\ntasks = "{TASKS}"\nonly = {list(only)}\n{more}\n'
            + "".join(f"[[rows]]\n{row}\n" for row in rows)
            + f'[models]\nplanner = "{planner}"\nprofile = "compact"\n'
        )
        return path

    return write


BABBLE = 'name = "babble"\noptions = { recall_k = 1 }'


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("only", "colour = 1\nonly", "unknown field `colour`"),
        ("only", "seeds = []\nonly", r"seeds = \[\]: one or more"),
        ("only", "seeds = [2, 2]\nonly", "seeds: 2 stands twice"),
        ("only", "seeds = [-1]\nonly", "each 0 or above"),
        ("only", 'world = "thorr"\nonly', "world: no worlds named 'thorr'. Did you mean 'thor'"),
        ("only", 'seeds = "many"\nonly', r"Expected `array`, got `str` - at `\$\.seeds`"),
        ("only", 'source = {kind = "x"}\nonly', "give either `tasks` or "),
        ("only", "= 1\nonly", "Invalid"),
        ("recall_k", 'recall_k = 1 }\nmodel = "y"\n#',
         r"unknown field `model` - at `\$\.rows\[0\]`"),
        ("[models]", '[[rows]]\nname = "babble"\n[models]', "rows: 'babble' stands twice"),
        ("only = ", "onyl = ", r"unknown field .*\n  To fix: write 'only'"),
        ("profile = ", "profil = ", r"unknown field .*\n  To fix: write 'profile'"),
        ("recall_k", "recall_k = 1 }\nmethud = { x", r"unknown field .*\n  To fix: write 'method'"),
        ("only = ", "zzz = ", r"unknown field .*\n  To fix: known here: name, rows, tasks, "),
        ("[models]", '[models]\nvision = "nanovlm"', r"models\.vision: .*Did you mean 'nano-vlm'"),
        ("[models]", '[models]\nrecall = "cosinus"', r"models\.recall: .*Did you mean 'cosine'"),
        ("[models]", '[models]\nembedder = "sentense:x"',
         r"models\.embedder: .*Did you mean 'sentence'"),
        ("simple-12", "simple-99",
         r"only: no task 'simple-99'; did you mean 'simple-\d\d'\? there are .*simple-01"),
    ],
)  # fmt: skip
def test_wrong_experiment_is_refused_by_key_with_what_was_meant_before_a_model_is_loaded(
    experiment, tmp_path, old, new, named
):
    path = experiment(BABBLE)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(FileError, match=rf"x\.toml: .*{named}"):
        Run(path, tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("tasks.jsonl", "none.jsonl", r"none\.jsonl: No such file"),
        ('planner = "', 'planner = "karma-nanno" # ', r"no model named 'karma-nanno'.*minilm"),
    ],
)
def test_missing_file_or_model_is_named(experiment, tmp_path, old, new, named):
    path = experiment()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileError, match=named):
        Run(path, tmp_path / "run")


@pytest.mark.parametrize(
    ("row", "named"),
    [
        ('name = "x"\noptions = { colour = "red" }', "unknown option 'colour'; known options: lo"),
        ('name = "x"\nmethod = "expert"\noptions = { k = 1 }', "unknown option 'k'"),
        ('name = "x"\nmethod = "exprt"', "Did you mean 'expert'"),
        ('name = "x"\noptions = { recall_k = "three" }', "Expected `int`.*recall_k"),
    ],
)
def test_wrong_row_is_refused_by_name_before_any_row_runs_and_mended_in_place(
    experiment, tmp_path, row, named
):
    folder, right = tmp_path / "run", 'name = "expert"\nmethod = "expert"'
    with pytest.raises(KarmaError, match=f"row 'x': .*{named}"):
        list(Run(experiment(right, row), folder).episodes())
    assert not (folder / "episodes.jsonl").exists()
    mended = Run(experiment(right, only=["simple-04"]), folder)  # though it is another one now
    assert [record.success for record in mended.episodes()] == [True]


def test_folder_that_another_run_has_taken_meanwhile_is_not_written(experiment, tmp_path):
    expert = 'name = "expert"\nmethod = "expert"'
    first = Run(experiment(expert), tmp_path / "run")
    second = Run(experiment(expert, only=["simple-04"]), tmp_path / "run")
    assert len(list(second.episodes())) == 1
    with pytest.raises(FileError, match="this folder holds a run of something else"):
        next(first.episodes())


def test_seeds_multiply_the_episodes(experiment, tmp_path):
    run = Run(experiment(more="seeds = [3, 5]"), tmp_path / "run")
    assert run.total == 2
    assert [(record.seed, record.error) for record in run.episodes()] == [(3, ""), (5, "")]
