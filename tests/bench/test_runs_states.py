"""Runs that keep what was computed of rooms: the same bytes, and a room is paid for once."""

from dataclasses import replace

import pytest
from support.run_files import ROOT, files
from support.written_tasks import write_tasks

from karma.agent.goals.files import load_tasks, with_whole
from karma.agent.journal.header import CONFIG, EPISODES
from karma.agent.journal.records import read_records
from karma.agent.journal.run_folder import read_run
from karma.bench.engine.run import Run
from karma.errors import FileError

SEQUENCES = ROOT / "eval" / "alfworld_r" / "tasks.jsonl"


@pytest.fixture
def write(tmp_path, planner):
    """A function that writes the experiment: a home whose four rooms are entered twice, or once."""
    (task,) = [task for task in load_tasks(SEQUENCES) if task.id == "house-0-00"]
    rooms = {(sub.scene or task.scene).name: sub for sub in task.subtasks}
    once = with_whole(replace(task, subtasks=tuple(rooms.values())))
    assert len(once.scenes) == 4
    twice = with_whole(replace(task, id="twice", subtasks=(*rooms.values(), *rooms.values())))
    write_tasks(tmp_path / "tasks.jsonl", [twice, once])

    def written(run):
        path = tmp_path / "x.toml"
        path.write_text(
            f'name = "x"\ntasks = "{tmp_path / "tasks.jsonl"}"\n'
            '[[rows]]\nname = "KARMA"\noptions = { attempts = 1 }\n'
            f'[models]\nplanner = "{planner}"\nprofile = "compact"\n[run]\n{run}\n'
        )
        return path

    return written


def done(path, folder, workers=1, **options):
    """Do a run; returns its files, where states came from, and the prompt tokens evaluated.

    Where states are kept is an option, so it stands in the configuration; that file is left out.
    """
    assert len(list(Run(path, folder, **options).episodes(workers=workers))) == 2
    answers = [
        (answer, timing)
        for record in read_records(folder / EPISODES)
        for sub, times in zip(
            record.subtasks, read_run(folder).timings[record.key].subtasks, strict=True
        )
        for answer, timing in zip(sub.answers, times.answers, strict=True)
    ]
    spent = sum(answer.prompt_tokens - timing.reused_tokens for answer, timing in answers)
    found = {name: content for name, content in files(folder).items() if name != CONFIG}
    return found, [timing.state for _, timing in answers], spent


def test_home_of_four_rooms_is_paid_for_once_and_by_later_runs_not_at_all(write, tmp_path):
    without, before, dear = done(write("states_memory_mb = 0"), tmp_path / "without")
    folder = tmp_path / "states"
    first, states, cheap = done(write(f'states = "{folder}"'), tmp_path / "first")
    assert first == without
    assert 4 <= states.count("evaluated") < before.count("evaluated")
    assert cheap < dear
    later, loaded, cheapest = done(write(""), tmp_path / "later", workers=2, states=folder)
    assert later == without
    assert set(loaded) == {"loaded", "kept"}
    assert cheapest < cheap


def test_size_below_nothing_is_refused_by_name(write, tmp_path):
    with pytest.raises(FileError, match="states_mb and states_memory_mb are 0 or more"):
        Run(write("states_mb = -1"), tmp_path / "run")
