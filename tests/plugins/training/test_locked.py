"""The locked tasks: unchanged since they were locked, doable, and not in what training says."""

import hashlib
import json
import runpy
from collections import Counter

import pytest
from support.paths import ROOT

from karma import registry
from karma.bench.methods.expert import ExpertMethod
from karma.files import to_json
from karma.goals.files import load_tasks
from karma.goals.goals import GoalTracker, WatchedWorld
from karma.plugins.alfred.sentences import plain
from karma.plugins.rooms.generate import build_scene
from karma.plugins.training.goal_sentences import read_sentences
from karma.plugins.training.packs import PlannerRecipe, draw_pack
from karma.plugins.training.sources import Sources
from karma.world.core.scene import SCENES, load

FOLDER = ROOT / "eval" / "locked"
SUMS = FOLDER / "SHA256SUMS"
LOCK = "f4a2b4e08033c28c8819f6ef45a721609b03e4efb5bf032a29a27c196110da80"
SEED = 4821  # of the rooms; training, its tests and the rooms that ship have others
TASKS = load_tasks(FOLDER / "tasks.jsonl")
ROOMS = sorted((FOLDER / "scenes").glob("*.json"))
SAID = {plain(sub.instruction) for task in TASKS for sub in task.subtasks}
each_task = pytest.mark.parametrize("task", TASKS, ids=[task.id for task in TASKS])


# ----------------------------------------------------------------- the lock


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_tasks_and_rooms_are_those_that_were_locked():
    """Whoever changes one of these files has another set: do not mend the digest, say so."""
    assert digest(SUMS) == LOCK
    sums = dict(reversed(line.split()) for line in SUMS.read_text().splitlines())
    files = [FOLDER / "tasks.jsonl", *ROOMS]
    assert sums == {str(path.relative_to(FOLDER)): digest(path) for path in files}


@pytest.mark.parametrize("path", ROOMS, ids=[path.stem for path in ROOMS])
def test_room_is_the_generators_with_a_seed_that_no_other_room_has(path):
    kind, number = path.stem.rsplit("_", 1)
    assert to_json(build_scene(kind, int(number), SEED)) == path.read_bytes()
    trained = {PlannerRecipe().seed + more for more in (77, 78, 79)}
    shipped = {int(load(one.stem).source.rsplit(" ", 1)[1]) for one in SCENES.glob("*.json")}
    assert SEED not in trained | shipped


# ----------------------------------------------------------------- the tasks


def test_tasks_are_twenty_of_a_kind_and_half_in_kitchens():
    assert Counter(task.kind for task in TASKS) == {"simple": 20, "composite": 20, "complex": 20}
    assert Counter(task.scene.name.split("_")[0] for task in TASKS) == {
        "kitchen": 28, "living": 12, "bedroom": 12, "bathroom": 8,
    }  # fmt: skip
    assert {task.scene.path for task in TASKS} == {str(path.relative_to(ROOT)) for path in ROOMS}


def test_instructions_are_each_said_once_and_not_in_the_development_tasks():
    rows = (ROOT / "eval" / "alfred_l" / "tasks.jsonl").read_text().splitlines()
    other = {plain(sub["instruction"]) for row in rows for sub in json.loads(row)["subtasks"]}
    assert len(SAID) == sum(len(task.subtasks) for task in TASKS) == 256
    assert not SAID & other


@each_task
def test_no_subtask_is_met_when_it_begins_and_the_expert_does_each(task, tmp_path):
    """So whoever does nothing solves none of them."""
    tracker = GoalTracker()
    world = WatchedWorld(registry.load("worlds", "embedded")(), tracker)
    tracker.start(world.reset(task.scene.source))
    agent = ExpertMethod().begin(world, task.scene, seed=0, folder=tmp_path)
    for sub in task.subtasks:
        tracker.begin_subtask(sub, world.last_event)
        assert tracker.unmet(sub.goals, world.last_event), sub.instruction
        list(agent.do(sub))
        assert not tracker.unmet(sub.goals, world.last_event), sub.instruction


# ----------------------------------------------------------------- and training


def test_the_training_command_keeps_the_sentences_out(tmp_path):
    sources = runpy.run_path(str(ROOT / "scripts" / "planner_data.py"))["sources"](tmp_path)
    assert not SAID - sources.unseen().sentences


def test_a_locked_sentence_that_training_would_say_is_drawn_again(tmp_path):
    """The sampler's own sentences, put into a locked file, are in no pack that it draws."""
    recipe = PlannerRecipe()
    free = Sources(folder=tmp_path, shared=tmp_path, tests=(), generated=8)
    data = free.material(recipe)
    said = [one.sentence for n in range(20) for one in draw_pack(recipe, data, "t", str(n))]
    line = json.loads((FOLDER / "tasks.jsonl").read_text().splitlines()[0])
    line["subtasks"] = [{"instruction": text, "goals": ["OPEN(Fridge)"]} for text in said]
    path = tmp_path / "locked.jsonl"
    path.write_text(json.dumps(line))
    kept = Sources(folder=tmp_path, shared=tmp_path, tests=(path,), generated=8)
    data = kept.material(recipe)
    again = [plain(one.sentence) for n in range(20) for one in draw_pack(recipe, data, "t", str(n))]
    assert not ({plain(text) for text in said} & set(again)) - {""}


@pytest.mark.shared
def test_no_instruction_stands_in_alfreds_training_split(shared):
    path = shared / "data" / "alfred" / "train.jsonl.gz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    assert not SAID & {plain(one.text) for one in read_sentences(path)}
