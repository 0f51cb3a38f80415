"""ALFRED's trials as tasks for our own agents: lists, rooms, sentences, whole runs, bad input."""

import json

import pytest
from support import alfred_kitchen as ours
from support.paths import ROOT, SHARED
from typer.testing import CliRunner

from karma.bench.engine.experiment import load
from karma.bench.engine.experiment_file import read_experiment
from karma.bench.engine.run import Run
from karma.bench.figures.columns import figures
from karma.bench.methods.expert import ExpertEpisode
from karma.cli import app
from karma.errors import FileError
from karma.files import decode_json
from karma.goals.goals import GoalTracker
from karma.plugins.alfred.published_tasks import AlfredTasks, alfred_tasks
from karma.plugins.alfred.replay.facts import gather, side_files
from karma.plugins.alfred.replay.goal import Deeds, conditions
from karma.plugins.alfred.replay.replay import fitted
from karma.plugins.alfred.replay.trial import read_trials
from karma.world.core.scene import Scene
from karma.world.sim import EmbeddedWorld

SAID = [
    {"task_desc": "Put the apple in the fridge."},
    {"task_desc": "Chill it, please!"},
]
FOLDER = "pick_and_place_simple-Apple-None-Fridge-7"
ROOM = f"{ours.PLAN}-ours_1"
LISTS = {
    "base": [{"task": f"{FOLDER}/ours_1", "instruction": "The fridge wants an apple."}],
    "bare": [{"task": f"{FOLDER}/ours_1", "repeat_idx": 1}, {"task": f"{FOLDER}/lost"},
             {"task": f"{FOLDER}/ours_1", "repeat_idx": 7}],
}  # fmt: skip
ROWS = '[[rows]]\nname = "expert"\nmethod = "expert"\n[[rows]]\nname = "idle"\nmethod = "idle"\n'


@pytest.fixture
def write(tmp_path, monkeypatch, planner):
    """A function that writes an experiment over our kitchen and returns its path."""
    monkeypatch.setenv("KARMA_SHARED", str(ours.reference(tmp_path / "ref")))
    trial = {**ours.trial(), "turk_annotations": SAID}
    ours.write(tmp_path / "trials.jsonl.gz", trial)
    trained = [{"task_desc": "put the apple in the FRIDGE", "high_descs": ["Go to the table"]}]
    ours.write(tmp_path / "train.jsonl.gz", {**trial, "turk_annotations": trained})
    (tmp_path / "lists.json").write_text(json.dumps(LISTS))

    def experiment(alfred='lists = "lists.json"\nby = "list"', *, top="", rows=ROWS):
        text = f'trials = "trials.jsonl.gz"\n{alfred}'
        for name in ("trials.jsonl.gz", "lists.json", "train.jsonl.gz", "none.jsonl.gz"):
            text = text.replace(f'"{name}"', f'"{tmp_path / name}"')
        path = tmp_path / "x.toml"
        models = f'[models]\nplanner = "{planner}"\nprofile = "compact"\n'
        path.write_text(f'name = "x"\n{top}\n[source]\nkind = "alfred"\n{text}\n{rows}{models}')
        return path

    return experiment


def loaded(path):
    return load(read_experiment(path), path)


def tasks_of(path):
    return {task.id: task for task in loaded(path).tasks}


# ----------------------------------------------------------------- what is asked


def test_listed_tasks_have_the_list_the_sentence_and_the_room_of_their_trial(write):
    path = write()
    tasks = tasks_of(path)
    assert list(tasks) == ["base/0", "bare/0", "bare/1", "bare/2"]
    said = [tasks[name].subtasks[0].instruction for name in ("base/0", "bare/0")]
    assert said == ["The fridge wants an apple.", "Chill it, please!"]
    assert [task.group for task in tasks.values()] == ["base", "bare", "bare", "bare"]
    task = tasks["base/0"]
    assert list(map(str, task.subtasks[0].goals)) == ["ON(Apple, Fridge): 1"]
    assert task.subtasks[0].is_whole
    assert [task.scene.name, *loaded(path).scenes] == [ROOM, ROOM]


def test_room_is_that_of_the_demonstration_at_its_start(write):
    path = write()
    found = decode_json(loaded(path).scenes[ROOM], Scene, path="x")
    (trial,) = read_trials(path.parent / "trials.jsonl.gz")
    wanted = fitted(trial, gather([trial], side_files())[ours.PLAN])
    assert found.name == ROOM
    assert (found.objects, found.agent, found.reachable) == (
        wanted.objects, wanted.agent, wanted.reachable
    )  # fmt: skip


def test_without_lists_everything_that_people_said_is_asked_as_it_stands(write):
    tasks = tasks_of(write(""))
    assert {name: task.subtasks[0].instruction for name, task in tasks.items()} == {
        "ours_1/0": SAID[0]["task_desc"], "ours_1/1": SAID[1]["task_desc"]
    }  # fmt: skip
    assert {task.group for task in tasks.values()} == {"pick_and_place_simple"}


def test_sentences_of_the_training_data_are_told_apart_whatever_their_case_and_marks(write):
    known = tasks_of(write('training = "train.jsonl.gz"'))
    assert [task.trained for task in known.values()] == [True, False]
    for training in ("", 'training = "none.jsonl.gz"'):
        assert [task.trained for task in tasks_of(write(training)).values()] == [None, None]


# ----------------------------------------------------------------- runs


def test_expert_solves_what_can_be_asked_and_what_cannot_is_named_and_failed(write, tmp_path):
    run = Run(write(), tmp_path / "run")
    assert run.tasks[0].scene.path == str(tmp_path / "run" / "scenes" / f"{ROOM}.json")
    records = {record.key[:2]: record for record in run.episodes()}
    assert [records["expert", name].success for name in ("base/0", "bare/0")] == [True, True]
    assert not any(one.success for (row, _), one in records.items() if row == "idle")
    lost, unsaid = records["expert", "bare/1"], records["expert", "bare/2"]
    assert lost.notes == ("unresolved bare/1: there is no trial lost",)
    assert unsaid.notes == ("unresolved bare/2: trial ours_1 has no annotation 7",)
    assert lost.error.startswith("FileError")
    rates = {(one.row, one.kind): one.values["success"].value for one in figures(run.records)}
    assert rates["expert", "base"] == rates["expert", "bare"] == 1.0  # of what can be asked
    shown = CliRunner().invoke(app, ["table", str(tmp_path / "run")], env={"COLUMNS": "200"})
    assert "our skills, another protocol" in shown.output
    written = (tmp_path / "run" / "table.md").read_text()
    assert all(name in written for name in ("bare/1", "bare/2"))


# ----------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("alfred", "top", "said"),
    [
        ("", 'tasks = "eval/alfred_l/tasks.jsonl"', "give either `tasks` or "),
        ("", 'only = ["ours_1/9"]', r"no task 'ours_1/9'; did you mean 'ours_1/[01]'\?"),
        (
            'lists = "lists.json"\nnames = ["spatial"]',
            "",
            r"lists\.json: no list 'spatial'; there are",
        ),
        ('by = "list"', "", "names and by = 'list' need `lists`"),
        ('lists = "none.jsonl.gz"', "", r"none\.jsonl\.gz: No such file"),
        ('list = "lists.json"', "", "unknown field `list`"),
        ('lists = "lists.json"\nby = "room"', "", "Invalid enum value 'room'"),
    ],
)
def test_wrong_source_of_tasks_is_named(write, alfred, top, said):
    with pytest.raises(FileError, match=said):
        loaded(write(alfred, top=top))


# ----------------------------------------------------------------- the reference data


def source(lists, **more):
    data = SHARED / "data"
    return AlfredTasks(
        trials=str(data / "alfred/valid_seen.jsonl.gz"), lists=str(data / lists), **more
    )


@pytest.mark.shared
@pytest.mark.parametrize("lists", ["eb_alfred/splits_even.json", "lota_alfred/splits_even.json"])
def test_every_task_of_the_half_lists_can_be_asked(lists):
    tasks, scenes = alfred_tasks(source(lists))
    assert len(tasks) == {"eb_alfred": 150, "lota_alfred": 348 + 104 + 19}[lists.split("/")[0]]
    assert [task.notes for task in tasks if task.notes] == []
    assert all(task.subtasks[0].goals and task.subtasks[0].instruction for task in tasks)
    assert {task.scene.name for task in tasks} == scenes.keys()


@pytest.mark.shared
def test_goals_hold_after_the_expert_just_where_conditions_of_alfred_do():
    """Both are asked of one and the same event: every 12th task, one of each list's types."""
    wanted = source("eb_alfred/splits_even.json", by="list")
    tasks, scenes = alfred_tasks(wanted)
    trials = {trial.id: trial for trial in read_trials(wanted.trials)}
    for task in tasks[::12]:
        scene = decode_json(scenes[task.scene.name], Scene, path=task.id)
        world, tracker = _Noting(scene), GoalTracker()
        trial = trials[task.scene.name.partition("-")[2]]
        episode = ExpertEpisode(world, task.scene)
        tracker.start(world.last_event)
        world.tracker = tracker
        for _ in episode.do(task.subtasks[0]):
            pass
        ours_met = not tracker.unmet(task.subtasks[0].goals, world.last_event)
        theirs = conditions(trial, world.last_event.metadata, world.deeds)
        assert ours_met == (theirs.met == theirs.of), task.id


class _Noting(EmbeddedWorld):
    """The world, with ALFRED's deeds and our tracker told of each event."""

    def __init__(self, scene):
        self.deeds, self.tracker = Deeds(agreeing=False), None
        super().__init__(scene)

    def step(self, action, **arguments):
        event = super().step(action, **arguments)
        if event.success:
            self.deeds.note(str(action), str(arguments.get("objectId", "")), event.metadata)
        if self.tracker is not None:
            self.tracker.update(event)
        return event


@pytest.mark.parametrize("name", ["eb_alfred_agents", "lota_alfred_agents", "alfred_sentences"])
def test_shipped_experiments_are_read(name):
    experiment = read_experiment(ROOT / "eval" / f"{name}.toml")
    assert experiment.name == name
    assert experiment.source["training"].endswith("alfred/train.jsonl.gz")
    assert {"expert", "idle"} <= {row.method for row in experiment.rows}
