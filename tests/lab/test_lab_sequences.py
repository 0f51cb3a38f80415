"""Sequences of tasks as episodes: drawn as traces are, each task done once on the way.

Covered: the draw that is told what was taken; going back without a trace; shorter sequences begin
longer ones; an episode's expert does all that was done while drawing; ALFRED's tasks in
AI2-THOR's rooms; task files as traces; the command.
"""

import gzip
import json
import os
import subprocess
import sys
from dataclasses import replace

import pytest
from support.paths import ROOT
from typer.testing import CliRunner

from karma.bench.episode import run_episode
from karma.cli import app
from karma.contracts import SceneRef
from karma.errors import KarmaError
from karma.lab.sequences import (
    DONE,
    NO_GOALS,
    NO_ROOM,
    NO_SENSE,
    NOT_THERE,
    TOO_HARD,
    Askable,
    Walk,
    askable,
    draw_sequence,
)
from karma.lab.tasks import Errand, Finds, Pool, alfred_pool, shipped_pool
from karma.lab.trace import read_traces
from karma.lab.workloads import TRIES, WORKLOADS, draw_errands, draws
from karma.methods.expert import ExpertEpisode, ExpertMethod
from karma.tasks.files import load_tasks, required_types, write_tasks
from karma.tasks.goals import GoalTracker, parse_goal
from karma.world.core.scene import load
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

LENGTH = 30
COMMITTED = ROOT / "eval" / "alfworld_r" / "tasks.jsonl"


def errand(scene, *goals, text="Do it."):
    return Errand(
        scene=scene, room=scene.split("_")[0], r4=("Apple",), m=("Apple",), subjects=("Apple",),
        kind="place", sentences=(text,), goals=tuple(map(parse_goal, goals)),
    )  # fmt: skip


def some(*errands):
    pool = Pool(source="a test", errands=errands, finds=Finds(places={}, found={}))
    return askable(pool, {one.scene: load(one.scene) for one in errands})


@pytest.fixture(scope="module")
def ours() -> Askable:
    pool = shipped_pool(3, tasks=40)
    return askable(pool, {one.scene: load(one.scene) for one in pool.errands})


@pytest.fixture(scope="module")
def drawn(ours):
    return {kind: draw_sequence(ours, kind, LENGTH, 5, 1) for kind in WORKLOADS}


# ----------------------------------------------------------------- the draw


@pytest.mark.parametrize("workload", WORKLOADS)
def test_draw_whose_tasks_are_all_taken_is_the_trace_of_old(workload, ours):
    told = draws(ours.pool, workload, 2, 0)
    taken = [next(told), *(told.send(True) for _ in range(199))]
    assert taken == draw_errands(ours.pool, workload, 200, 2, 0)


@pytest.mark.parametrize("workload", ["rooms", "habit"])
def test_task_that_is_not_taken_is_drawn_anew_from_the_same_room(workload, ours):
    told = draws(ours.pool, workload, 2, 0)
    first = next(told)
    again = [told.send(False) for _ in range(TRIES - 1)]
    assert {one.scene for one in again} == {first.scene}
    assert len(set(again)) > 1


def test_draw_that_nobody_takes_goes_on_to_the_next_task(ours):
    told = draws(ours.pool, "habit", 2, 0)
    refused = [next(told), *(told.send(False) for _ in range(12 * TRIES - 1))]
    assert len({one.room for one in refused}) == 4  # a day sees every room


def test_chain_goes_on_about_what_was_taken_and_not_about_what_was_refused(ours):
    told = draws(ours.pool, "chain", 4, 0)
    first = next(told)
    refused = [told.send(not number) for number in range(60 * TRIES)]
    slots = [refused[start : start + TRIES] for start in range(0, len(refused), TRIES)]
    chained = [slot for slot in slots if len({one.scene for one in slot}) == 1]
    assert 15 < len(chained) < 45  # one in two
    about = {(first.scene, name) for name in first.subjects}
    assert all(about & {(one.scene, n) for n in one.subjects} for slot in chained for one in slot)


# ----------------------------------------------------------------- going back


def moment(walk):
    return {name: event.metadata for name, event in walk.moments.items()}


def test_refused_task_leaves_no_trace():
    take = errand("kitchen_1", "ON(Apple, CounterTop)", "STATE(Apple, cleaned)")
    hard = errand("bedroom_1", "HOLDON(robot, Book)", "ON(Book, Bed)")  # both at once cannot be
    vain = errand("kitchen_1", "STATE(Egg, sliced)", "HOLDON(robot, Egg)", "ON(Egg, Fridge)")
    after = errand("bedroom_1", "ON(Book, Bed)")
    tasks = some(take, hard, vain, after)
    plain, tried = Walk(tasks), Walk(tasks)
    assert not plain.refusal(take)
    assert not tried.refusal(take)
    before = moment(tried)
    assert tried.refusal(hard) == TOO_HARD
    assert tried.refusal(vain) == TOO_HARD
    assert moment(tried)["kitchen_1"] == before["kitchen_1"]
    for walk in (plain, tried):
        assert not walk.refusal(after)
    assert moment(tried) == moment(plain)


def test_refused_first_task_is_no_beginning():
    hard = errand("bedroom_1", "HOLDON(robot, Book)", "ON(Book, Bed)")
    easy = errand("kitchen_1", "ON(Apple, CounterTop)", "STATE(Apple, cleaned)")
    tried, plain = Walk(some(hard, easy)), Walk(some(hard, easy))
    assert tried.refusal(hard) == TOO_HARD
    assert not tried.moments
    assert not tried.refusal(easy)
    assert not plain.refusal(easy)
    assert moment(tried) == moment(plain)


@pytest.mark.parametrize("workload", WORKLOADS)
def test_walk_of_the_taken_tasks_alone_ends_in_the_same_home(workload, ours):
    told, walk, taken = draws(ours.pool, workload, 5, 1), Walk(ours), []
    one, refused = next(told), 0
    while len(taken) < LENGTH:
        reason = walk.refusal(one)
        refused += bool(reason)
        taken += [] if reason else [one]
        one = told.send(not reason)
    assert refused
    alone = Walk(ours)
    assert [alone.refusal(one) for one in taken] == [""] * LENGTH
    assert {name: alone.moments[name].metadata for name in alone.moments} == {
        name: walk.moments[name].metadata for name in alone.moments
    }


def test_reasons_are_told_apart():
    put = errand("kitchen_1", "ON(Apple, CounterTop)", "STATE(Apple, cleaned)")
    same = errand("kitchen_1", "ON(Apple, CounterTop)")
    none = errand("kitchen_1", "ON(Pillow, Bed)")
    walk = Walk(some(put, same, none))
    assert walk.refusal(none) == NOT_THERE
    assert not walk.refusal(put)
    assert walk.refusal(put) == DONE  # nobody asks twice running
    assert walk.refusal(same) == DONE


def test_two_of_a_kind_are_asked_for_where_there_are_two():
    two, one = (errand("bedroom_1", f"2*ON({kind}, Dresser)") for kind in ("CD", "Laptop"))
    walk = Walk(some(two, one))
    assert walk.refusal(one) == NOT_THERE
    assert not walk.refusal(two)
    assert walk.refusal(two) == DONE


# ----------------------------------------------------------------- sequences


@pytest.mark.parametrize("workload", WORKLOADS)
def test_shorter_sequence_begins_the_longer_one(workload, ours, drawn):
    short = draw_sequence(ours, workload, 7, 5, 1)
    assert short.task.subtasks == drawn[workload].task.subtasks[:7]


def test_sequences_differ_by_number_and_by_seed(ours):
    tasks = {
        draw_sequence(ours, "house", 5, seed, number).task.subtasks
        for seed in (1, 2)
        for number in (0, 1)
    }
    assert len(tasks) == 4


@pytest.mark.parametrize("workload", WORKLOADS)
def test_expert_of_an_episode_does_every_task(workload, drawn, tmp_path):
    task = drawn[workload].task
    path = tmp_path / "tasks.jsonl"
    write_tasks(path, [task])
    (read,) = load_tasks(path)
    record = run_episode(
        ExpertMethod(), Home(EmbeddedWorld), read, row="expert", seed=0, folder=tmp_path
    )
    assert not record.error
    assert [sub.unmet for sub in record.subtasks] == [()] * LENGTH


@pytest.mark.parametrize("workload", WORKLOADS)
def test_no_task_is_done_when_its_turn_comes(workload, drawn, ours):
    """Said by an episode's own tracker, started anew for each task."""
    home, tracker = Home(EmbeddedWorld), GoalTracker()
    for number, sub in enumerate(drawn[workload].task.subtasks):
        scene = (sub.scene or drawn[workload].task.scene).name
        if not number:
            home.reset(scene)
            expert = ExpertEpisode(home, SceneRef.of(scene))
        elif scene != home.scene:
            home.enter(scene)
            expert.enter(SceneRef.of(scene))
        tracker.start(home.last_event)
        assert tracker.unmet(sub.goals, home.last_event), sub
        for _ in expert.do(replace(sub, whole=sub.instruction)):
            pass


def test_house_has_one_room_of_each_kind(drawn):
    kinds = [scene.name.split("_")[0] for scene in drawn["house"].task.scenes]
    assert len(set(kinds)) == len(kinds)


def test_home_in_which_everything_is_done_is_given_up():
    tasks = some(*(errand(f"{room}_1", goal) for room, goal in (
        ("kitchen", "ON(Apple, Fridge)"), ("living", "ON(Book, Sofa)"),
        ("bedroom", "ON(Book, Bed)"), ("bathroom", "ON(SoapBar, Sink)"),
    )))  # fmt: skip
    with pytest.raises(KarmaError, match="nothing more can be done in this home"):
        draw_sequence(tasks, "house", 25, 0, 0)


def test_tasks_that_cannot_be_asked_for_are_left_out_by_reason():
    good = errand("kitchen_1", "ON(Apple, Fridge)")
    odd = (
        replace(good, goals=()),
        replace(good, scene="FloorPlan99"),
        errand("kitchen_1", "ON(Apple, Glassbottle)"),
        errand("kitchen_1", "ON(Apple, SoapBottle)"),
        errand("kitchen_1", "ON(Plunger, Bathtub)"),
    )
    pool = Pool(source="a test", errands=(good, *odd), finds=Finds(places={}, found={}))
    left = askable(pool, {"kitchen_1": load("kitchen_1")})
    assert left.pool.errands == (good,)
    assert left.left_out == {NO_GOALS: 1, NO_ROOM: 1, NO_SENSE: 3}


# ----------------------------------------------------------------- ALFRED's tasks


def trial(kind, plan="FloorPlan1", votes=((1, 1), (1, 0)), **targets):
    wanted = {"object_target": "", "parent_target": "", "toggle_target": "", "mrecep_target": "",
              "object_sliced": False, **targets}  # fmt: skip
    notes = [{"task_desc": f"sentence {n}", "votes": list(v)} for n, v in enumerate(votes)]
    return {
        "task_type": kind, "pddl_params": wanted, "scene": {"floor_plan": plan},
        "plan": {"high_pddl": []}, "turk_annotations": notes,
    }  # fmt: skip


ALFREDS = [
    (trial("pick_and_place_simple", object_target="Apple", parent_target="SinkBasin"),
     "ON(Apple, Sink)"),
    (trial("look_at_obj_in_light", object_target="Book", toggle_target="DeskLamp"),
     "HOLDON(robot, Book) TOGGLEON(DeskLamp)"),
    (trial("pick_and_place_with_movable_recep", object_target="Fork", mrecep_target="Pan",
           parent_target="CounterTop"), "ON(Fork, Pan) ON(Pan, CounterTop)"),
    (trial("pick_heat_then_place_in_recep", object_target="Potato", parent_target="Fridge",
           object_sliced=True), "STATE(Potato, sliced) STATE(Potato, heated) ON(Potato, Fridge)"),
    (trial("pick_two_obj_and_place", object_target="Apple", parent_target="Fridge"),
     "2*ON(Apple, Fridge)"),
    (trial("pick_two_obj_and_place", object_target="Apple", parent_target="Fridge",
           object_sliced=True), "2*STATE(Apple, sliced) 2*ON(Apple, Fridge)"),
]  # fmt: skip


@pytest.mark.parametrize(("row", "goals"), ALFREDS)
def test_goals_of_an_alfred_task_are_those_of_its_parameters(row, goals, tmp_path):
    path = tmp_path / "trials.jsonl.gz"
    path.write_bytes(gzip.compress(json.dumps(row).encode()))
    (one,) = alfred_pool([path]).errands
    assert " ".join(str(goal).removesuffix(": 1") for goal in one.goals) == goals
    assert one.sentences == ("sentence 0",)  # all voters found it right


def test_sentences_nobody_agreed_on_are_taken_where_there_are_no_others(tmp_path):
    path = tmp_path / "trials.jsonl.gz"
    row = trial("pick_and_place_simple", votes=((0, 1), (1, 0)), object_target="Apple",
                parent_target="Fridge")  # fmt: skip
    path.write_bytes(gzip.compress(json.dumps(row).encode()))
    (one,) = alfred_pool([path]).errands
    assert one.sentences == ("sentence 0", "sentence 1")


@pytest.mark.shared
def test_alfreds_tasks_are_done_in_ai2thors_rooms(shared, tmp_path):
    out = tmp_path / "tasks.jsonl"
    result = CliRunner().invoke(app, [
        "sequences", str(out), "--number", "1", "--length", "25",
        "--tasks", str(shared / "data" / "alfred" / "valid_seen.jsonl.gz"),
        "--scenes", str(shared / "data" / "thor5" / "scenes.jsonl.gz"),
        "--layouts", str(shared / "data" / "alfred" / "layouts.json.gz"), "--workload", "type",
    ])  # fmt: skip
    assert result.exit_code == 0, result.output
    (task,) = load_tasks(out)
    assert len(task.subtasks) == 25
    assert all(scene.path == str(tmp_path / "scenes" / f"{load(scene.path).name}.json")
               for scene in task.scenes)  # fmt: skip
    record = run_episode(
        ExpertMethod(), Home(EmbeddedWorld), task, row="expert", seed=0, folder=tmp_path
    )
    assert not any(sub.unmet for sub in record.subtasks)


# ----------------------------------------------------------------- the files and the command


def test_task_file_is_a_trace_of_what_hits_are_counted_over(drawn, tmp_path):
    path = tmp_path / "tasks.jsonl"
    write_tasks(path, [drawn["house"].task, drawn["type"].task])
    first, second = read_traces(path)
    wanted = [list(dict.fromkeys(required_types(sub))) for sub in drawn["house"].task.subtasks]
    assert [[key.split("/")[1] for key in task] for task in first.named()] == wanted
    assert {key.split("/")[0] for key in second.keys} == {
        scene.name for scene in drawn["type"].task.scenes
    }


def test_command_draws_the_same_file_again_and_tells_what_was_drawn(tmp_path):
    words = ["--workload", "house", "--workload", "rooms", "--number", "1", "--length", "6"]
    done = [
        CliRunner().invoke(app, ["sequences", str(tmp_path / name), *words])
        for name in ("a.jsonl", "b.jsonl")
    ]
    assert [one.exit_code for one in done] == [0, 0], done[0].output
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()
    about = json.loads((tmp_path / "a.drawn.json").read_text())
    tasks = load_tasks(tmp_path / "a.jsonl")
    assert [one["id"] for one in about["sequences"]] == [task.id for task in tasks]
    assert all(sum(one["kinds"].values()) == 6 for one in about["sequences"])
    rows = {line.split()[1]: line.split() for line in done[0].output.splitlines() if "│" in line}
    for one in about["sequences"]:
        row = rows[one["id"].split("-")[0]]
        assert {str(count) for count in one["drawn_anew"].values()} <= set(row)


def test_same_bytes_whatever_the_hash_seed(tmp_path):
    files = []
    for seed in ("1", "2"):
        path = tmp_path / f"{seed}.jsonl"
        words = ["--workload", "chain", "--number", "1", "--length", "15"]
        subprocess.run(
            [sys.executable, "-c", "from karma.cli import app; app()", "sequences", path, *words],
            env={**os.environ, "PYTHONHASHSEED": seed}, check=True, capture_output=True,
        )  # fmt: skip
        files.append((path.read_bytes(), path.with_suffix(".drawn.json").read_bytes()))
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--workload", "hose"], "no workload 'hose'; there are type, house"),
        (["--length", "0"], "--length"),
        (["--tasks", "nowhere.jsonl.gz"], "--tasks and --scenes go together"),
        (["--tasks", "nowhere.jsonl.gz", "--scenes", "no.jsonl"], "nowhere.jsonl.gz: No such file"),
    ],
)
def test_command_refuses_what_cannot_be_drawn(words, said, tmp_path):
    result = CliRunner().invoke(app, ["sequences", str(tmp_path / "out.jsonl"), *words])
    assert result.exit_code != 0
    assert said in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


def test_command_replaces_a_file_only_when_told_to(tmp_path):
    out = tmp_path / "out.jsonl"
    out.write_text("mine")
    words = ["sequences", str(out), "--number", "1", "--length", "2"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 1
    assert "--force" in result.output
    assert out.read_text() == "mine"
    assert CliRunner().invoke(app, [*words, "--force"]).exit_code == 0
    assert len(load_tasks(out)) == 1


def test_committed_sequences_are_still_done_by_the_expert(tmp_path):
    """The skills by which the expert acts may change: then what it can do may, too."""
    tasks = load_tasks(COMMITTED)
    assert len(tasks) == 15
    for task in tasks:
        record = run_episode(
            ExpertMethod(), Home(EmbeddedWorld), task, row="expert", seed=0, folder=tmp_path
        )
        assert not [sub.instruction for sub in record.subtasks if sub.unmet], task.id
        assert len(record.subtasks) == len(task.subtasks), record.error


def test_task_file_of_another_name_is_refused_before_anything_is_drawn(tmp_path):
    result = CliRunner().invoke(app, ["sequences", str(tmp_path / "out.json")])
    assert result.exit_code == 1
    assert "out.jsonl" in result.output
    assert not list(tmp_path.iterdir())
