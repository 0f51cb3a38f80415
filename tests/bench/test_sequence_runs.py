"""Runs of sequences over several rooms: the same bytes whoever does them, killed or not."""

from dataclasses import replace

import pytest
from support.run_files import TASKS, files
from support.written_tasks import write_tasks

from karma.bench.engine.run import Run
from karma.bench.figures.metrics import related_needs
from karma.bench.figures.results import result_of, to_csv
from karma.bench.figures.tables import sheets
from karma.errors import KarmaError
from karma.goals.files import load_tasks, with_whole
from karma.journal.entries import Enter
from karma.journal.run_folder import read_run
from karma.journal.steps import read_steps, steps_path
from karma.types.space import SceneRef
from karma.types.tasks import Task

ROOMS = ("kitchen_1", "bedroom_1")


def sequence(name, length):
    """Return a sequence that asks in the two rooms in turn for what our tasks ask there."""
    tasks = load_tasks(TASKS)
    pools = [[sub for task in tasks if task.scene.name == room for sub in task.subtasks]
             for room in ROOMS]  # fmt: skip
    parts = [
        replace(pools[number % 2][number // 2 % 5], scene=SceneRef.of(ROOMS[number % 2]))
        for number in range(length)
    ]
    return with_whole(
        Task(id=name, kind="sequence", scene=SceneRef.of(ROOMS[0]), subtasks=tuple(parts))
    )


def write_experiment(folder, planner, seeds="[0]"):
    write_tasks(folder / "tasks.jsonl", [sequence("s-a", 4), sequence("s-b", 3)])
    path = folder / "x.toml"
    path.write_text(
        f'name = "x"\ntasks = "{folder / "tasks.jsonl"}"\nseeds = {seeds}\n'
        '[[rows]]\nname = "expert"\nmethod = "expert"\n'
        '[[rows]]\nname = "KARMA"\noptions = { recall_k = 3 }\n'
        '[[rows]]\nname = "memory off"\noptions = { short_term = false }\n'
        f'[models]\nplanner = "{planner}"\nprofile = "compact"\n'
    )
    return path


@pytest.fixture(scope="module")
def whole(planner, tmp_path_factory):
    """An undisturbed run: (experiment, folder)."""
    folder = tmp_path_factory.mktemp("whole")
    path = write_experiment(folder, planner)
    assert len(list(Run(path, folder / "run").episodes())) == 6
    return path, folder / "run"


def test_record_tells_room_method_and_what_it_comes_back_to(whole):
    _, folder = whole
    data = read_run(folder)
    assert set(data.header.scenes) == set(ROOMS)
    for record in data.records:
        assert (record.kind, record.scene, record.error) == ("sequence", ROOMS[0], "")
        scenes = [sub.scene or record.scene for sub in record.subtasks]
        assert scenes == [ROOMS[number % 2] for number in range(len(scenes))]
        related = related_needs(record)
        assert not related[0]
        assert not related[1]  # the first in the other room
    methods = {record.row: record.method for record in data.records}
    assert methods == {
        "expert": "expert", "KARMA": "KARMA", "memory off": "KARMA (w/o short term memory)",
    }  # fmt: skip


def test_log_begins_in_the_first_room_and_enters_the_others(whole):
    _, folder = whole
    for record in read_run(folder).records:
        start, *steps = read_steps(steps_path(folder, *record.key))
        assert start == Enter(scene=ROOMS[0])
        moves = [step.scene for step in steps if isinstance(step, Enter)]
        assert moves == [sub.scene or ROOMS[0] for sub in record.subtasks][1:]


def test_same_bytes_again_and_with_two_workers(whole, tmp_path):
    path, folder = whole
    list(Run(path, tmp_path / "run").episodes(workers=2))
    assert files(tmp_path / "run") == files(folder)


def test_other_seeds_are_refused_before_anything_is_run(planner, tmp_path):
    path = write_experiment(tmp_path, planner, seeds="[0, 1]")
    with pytest.raises(KarmaError, match="'s-a' has no other days, only seed 0"):
        Run(path, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_tables_have_the_kind_and_print_no_hits_without_memory(whole):
    _, folder = whole
    result = result_of(read_run(folder), {})
    main, costs, *_ = sheets(result)
    assert main.title == "x: sequence tasks"
    assert "read their share in the next table" in main.caption
    assert [line[0] for line in main.lines] == ["expert", "KARMA", "memory off"]
    assert {line[column] for line in main.lines for column in (2, 4, 6, 8)} == {"–"}  # published
    assert main.lines[1][5] != "–"  # RE against the twin
    for row in costs.lines:
        found = dict(zip(costs.head, row, strict=True))
        assert found["MHR cold"] == "–" or row[0] == "KARMA"
        assert found["sub-tasks"] != "–"
    assert ",sequence,success," in to_csv(result)
