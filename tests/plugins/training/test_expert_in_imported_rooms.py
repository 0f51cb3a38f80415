"""The expert in rooms of AI2-THOR's dumps and of ALFRED's trials."""

from pathlib import Path

import pytest

from karma.bench.engine.episode import run_episode
from karma.bench.methods.expert import ExpertMethod
from karma.files import to_json
from karma.goals.files import load_tasks
from karma.plugins.alfred.published_tasks import task_of
from karma.plugins.alfred.replay.facts import gather, side_files
from karma.plugins.alfred.replay.replay import fitted
from karma.plugins.alfred.replay.trial import read_trials
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.task_files import draw_tasks
from karma.types.space import SceneRef
from karma.world.sim import EmbeddedWorld


@pytest.mark.shared
def test_expert_does_unfiltered_tasks_in_dumped_rooms(shared, tmp_path):
    dumps, layouts = shared / "data/thor5/scenes.jsonl.gz", shared / "data/alfred/layouts.json.gz"
    scenes = [one for n, one in enumerate(import_dump(dumps, layouts=layouts)) if n % 13 == 0]
    book = our_book().part(held_out=True)
    draw_tasks(tmp_path, book, scenes=scenes, each=6, seed=5, filtered=False)
    tasks = load_tasks(tmp_path / "tasks.jsonl")
    failed = [task.id for task in tasks if not is_done(task, tmp_path)]
    assert len(failed) <= 1, failed


@pytest.mark.shared
def test_expert_does_tasks_of_alfreds_trials(shared, tmp_path):
    trials = list(read_trials(shared / "data/alfred/valid_seen.jsonl.gz"))[::18]
    facts = gather(trials, side_files())
    failed = []
    for trial in trials:
        path = tmp_path / f"{trial.id}.json"
        path.write_bytes(to_json(fitted(trial, facts[trial.scene.floor_plan])))
        task = task_of(trial, "do it", scene=SceneRef(name=trial.id, path=str(path)))
        if not is_done(task, tmp_path):
            failed.append(trial.id)
    assert len(trials) >= 10
    assert failed == []


def is_done(task, folder: Path):
    record = run_episode(ExpertMethod(), EmbeddedWorld(), task, row="expert", seed=0, folder=folder)
    return not record.error and not any(sub.unmet for sub in record.subtasks)
