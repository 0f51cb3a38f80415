"""Sweeps: every cell a run, one table, the same bytes however often they are killed."""

import csv
import io
import time

import pytest
from support.run_files import TASKS, copy, files, karma, lines_in, started
from typer.testing import CliRunner

from karma.agent.journal.header import EPISODES, RESULTS
from karma.agent.journal.owned_folder import locked
from karma.agent.journal.records import read_records
from karma.agent.journal.run_folder import read_run
from karma.bench.engine.export import to_csv
from karma.bench.engine.run import Run
from karma.bench.engine.sweep import SweepRun
from karma.bench.engine.sweep_folder import CELLS, SWEEP, TABLE, read_sweep
from karma.cli import app, shared
from karma.errors import FileError, KarmaError
from karma.testing import make_planner

ONLY = ["simple-11"]
TEXT = f"""
name = "swept"
tasks = "{TASKS}"
only = {ONLY}
[[rows]]
name = "babble"
options = {{ attempts = 1 }}
[[rows]]
name = "expert"
method = "expert"
[models]
threads = 1
[run]
steps = false
"""
GRID = """
[[grid]]
models.planner = ["a.gguf", "b.gguf"]
rows."babble".options.recall_k = [1, 3]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two planners, one of them of another family, and an experiment."""
    place = tmp_path_factory.mktemp("sweep")
    make_planner(place / "a.gguf", "llama3", seed=1)
    make_planner(place / "b.gguf", "qwen2.5", seed=2)
    (place / "x.toml").write_text(TEXT + GRID)
    return place


@pytest.fixture(scope="module")
def whole(folder):
    """An undisturbed sweep."""
    sweep = SweepRun(folder / "x.toml", folder / "whole")
    done = list(sweep.episodes(1))
    assert len(done) == 4 * 2
    assert sweep.failed == {}
    return folder / "whole"


def swept(folder):
    """All that must be the same in every sweep, cell by cell."""
    cells = {place.name: files(place) for place in sorted((folder / CELLS).iterdir())}
    return cells, (folder / SWEEP).read_bytes(), (folder / TABLE).read_bytes()


def karma_eval(*words):
    return CliRunner().invoke(app, ["eval", *map(str, words)], env={"COLUMNS": "200"})


# ----------------------------------------------------------------- cells


def cells(folder, text):
    path = folder / "x.toml"
    path.write_text(TEXT + text)
    return SweepRun(path, folder / "run").cells


def test_cells_are_every_combination_and_several_grids_stand_side_by_side(tmp_path):
    found = cells(
        tmp_path,
        '[[grid]]\nmodels.recall = ["stateful", "cosine"]\nseeds = [[0], [1, 2]]\n'
        '[[grid]]\nmodels.recall = "cosine"\nmodels.examples = [5]\n'
        '[[grid]]\nmodels.recall = ["cosine"]\nseeds = [[0]]\n',
    )
    assert [cell.kept.name for cell in found] == [
        "recall=stateful, seeds=[0]",
        "recall=stateful, seeds=[1,2]",
        "recall=cosine, seeds=[0]",
        "recall=cosine, seeds=[1,2]",
        "recall=cosine, examples=5",
    ]
    assert len({cell.kept.folder for cell in found}) == 5


def test_planners_of_one_name_are_told_apart(tmp_path):
    found = cells(tmp_path, '[[grid]]\nmodels.planner = ["one/p.gguf", "two/p.gguf"]\n')
    assert [cell.kept.name for cell in found] == ["planner=one/p.gguf", "planner=two/p.gguf"]
    assert len({cell.kept.folder for cell in found}) == 2


@pytest.mark.parametrize(
    ("grid", "words"),
    [
        ("[[grid]]\nmodels.plannr = ['x']", "write 'planner'"),
        ("[[grid]]\nmodels.planner = []", "models.planner has no value"),
        ("[[grid]]\n", "it sets nothing"),
        ("[[grid]]\nseeds = [[0], ['x']]", "seeds = "),
        ("[[grid]]\nrows.expret.method = ['idle']", "Did you mean 'expert'"),
        ("[[grid]]\nmodels.vision = ['metdata']", "Did you mean 'metadata'"),
    ],
)
def test_wrong_grid_is_refused_before_anything_is_done(tmp_path, grid, words):
    with pytest.raises(KarmaError, match=words):
        cells(tmp_path, grid)
    assert not (tmp_path / "run").exists()


# ----------------------------------------------------------------- one folder, one table


def test_each_cell_is_a_run_of_its_own_with_what_it_was_told(whole):
    data = read_sweep(whole)
    runs = [data.run(cell) for cell in data.cells]
    assert [run.finished for run in runs] == [True] * 4
    planners = [run.header.models["planner"].partition(" ")[0] for run in runs]
    assert planners == ["a", "a", "b", "b"]
    assert len({run.header.experiment for run in runs}) == 4
    assert [cell.values for cell in data.cells][:2] == [
        {"planner": "a", "recall_k": "1"},
        {"planner": "a", "recall_k": "3"},
    ]


def test_table_has_a_line_per_cell_and_row(whole, monkeypatch):
    lines = (whole / TABLE).read_text().splitlines()
    table = [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")]
    assert table[0][:5] == ["planner", "recall_k", "method", "SR", "solved"]
    assert [line[:3] for line in table[1:]] == [
        [planner, k, row] for planner in "ab" for k in "13" for row in ("babble", "expert")
    ]
    assert all(line[4] == "1 of 1" for line in table[1:] if line[2] == "expert")
    monkeypatch.setattr(shared.console, "width", 200)
    result = karma("table", whole)
    assert result.count("expert") == 4


def test_cell_that_cannot_be_done_is_named_and_the_others_are_done(folder, tmp_path):
    path = tmp_path / "x.toml"
    (tmp_path / "broken.gguf").write_bytes(b"GGUF" + bytes(40))
    grid = f'[[grid]]\nmodels.planner = ["broken.gguf", "none.gguf", "{folder}/a.gguf"]\n'
    path.write_text(TEXT + grid)
    result = karma_eval(path, "--out", tmp_path / "run", "--workers", 1, "--limit", 1)
    assert result.exit_code == 1
    data = read_sweep(tmp_path / "run")
    assert [bool(cell.failed) for cell in data.cells] == [True, True, False]
    assert "none.gguf" in data.cells[1].failed
    assert read_run(tmp_path / "run" / CELLS / data.cells[2].folder).finished
    assert "Failed: planner=broken" in (tmp_path / "run" / TABLE).read_text()
    make_planner(tmp_path / "none.gguf", "llama3", seed=3)
    again = karma_eval(path, "--out", tmp_path / "run", "--workers", 1, "--limit", 1)
    assert [bool(c.failed) for c in read_sweep(tmp_path / "run").cells] == [True, False, False]
    assert again.exit_code == 1


def test_grid_that_grows_keeps_what_is_done(folder, whole, tmp_path):
    run = copy(whole, tmp_path / "run")
    path = folder / "more.toml"
    path.write_text(TEXT + GRID.replace("[1, 3]", "[1, 3, 5]"))
    sweep = SweepRun(path, run)
    assert len(list(sweep.episodes(1))) == 2 * 2
    before = swept(whole)[0]
    assert {name: found for name, found in swept(run)[0].items() if name in before} == before


def test_folders_of_sweeps_and_runs_are_not_mixed(folder, whole, tmp_path):
    plain = tmp_path / "plain.toml"
    plain.write_text(TEXT)
    with pytest.raises(FileError, match="this folder holds a sweep"):
        Run(plain, whole)
    with pytest.raises(FileError, match=r"it has a \[\[grid\]\]: a sweep, not a run"):
        Run(folder / "x.toml", tmp_path / "run")
    with pytest.raises(FileError, match="a sweep, of many runs"):
        read_run(whole)
    with pytest.raises(FileError, match="this folder holds a run, not a sweep"):
        SweepRun(folder / "x.toml", next((whole / CELLS).iterdir()))
    with locked(whole), pytest.raises(KarmaError, match="another run is at work"):
        SweepRun(folder / "x.toml", whole)


def test_cell_of_a_damaged_sweep_file_never_lies_elsewhere(whole, tmp_path):
    run = copy(whole, tmp_path / "run")
    first = read_sweep(run).cells[0].folder
    text = (run / SWEEP).read_text()
    for bad in ("../../x", "", "a/b", ".."):
        (run / SWEEP).write_text(text.replace(f'"{first}"', f'"{bad}"'))
        with pytest.raises(FileError, match="no folder below cells"):
            read_sweep(run)


# ----------------------------------------------------------------- killed


def test_sweep_killed_twice_gives_the_bytes_of_one_that_was_not(folder, whole, tmp_path):
    run = tmp_path / "run"
    for kill in (1, 2):
        process = started(folder / "x.toml", run)
        end = time.monotonic() + 300
        while process.is_alive() and time.monotonic() < end:
            if sum(map(lines_in, run.glob(f"{CELLS}/*/{EPISODES}"))) >= kill:
                break
            time.sleep(0.005)
        process.kill()
        process.join()
        assert not all((place / RESULTS).exists() for place in (run / CELLS).iterdir())
    done = sum(len(read_records(place)) for place in run.glob(f"{CELLS}/*/{EPISODES}"))
    assert done >= 2
    sweep = SweepRun(folder / "x.toml", run)
    assert len(list(sweep.episodes(1))) >= 1
    assert swept(run) == swept(whole)


# ----------------------------------------------------------------- export


def test_csv_has_a_line_per_episode(whole, tmp_path):
    rows = list(csv.DictReader(io.StringIO(to_csv(whole).decode())))
    assert len(rows) == 8
    assert {row["cell"] for row in rows} == {cell.name for cell in read_sweep(whole).cells}
    assert rows[0]["set.planner"] == "a"
    assert {row["succeeded"] for row in rows if row["row"] == "expert"} == {"True"}
    assert {row["planner_calls"] for row in rows if row["row"] == "expert"} == {""}
    out = tmp_path / "out.csv"
    karma("export", whole, "--out", out)
    assert out.read_bytes() == to_csv(whole)


# ----------------------------------------------------------------- what tasks and models cannot


def test_model_whose_context_holds_no_prompt_fails_its_cell(tmp_path):
    make_planner(tmp_path / "a.gguf", "llama3", seed=1)
    text = TEXT.replace("threads = 1", "threads = 1\nn_ctx = 64")
    (tmp_path / "x.toml").write_text(text + '[[grid]]\nmodels.planner = ["a.gguf"]\n')
    sweep = SweepRun(tmp_path / "x.toml", tmp_path / "run")
    assert list(sweep.episodes(1)) == []
    assert "has a context of 64; so no request can be asked" in sweep.failed["planner=a"]


def test_prompts_that_do_not_fit_are_named_under_the_table(tmp_path):
    make_planner(tmp_path / "a.gguf", "llama3", seed=1)
    text = TEXT.replace("threads = 1", "threads = 1\nn_ctx = 800")
    text = text.replace(str(ONLY), '["simple-11", "simple-14"]')
    (tmp_path / "x.toml").write_text(text + '[[grid]]\nmodels.planner = ["a.gguf"]\n')
    sweep = SweepRun(tmp_path / "x.toml", tmp_path / "run")
    assert len(list(sweep.episodes(1))) == 2 * 2
    assert sweep.failed == {}
    table = (tmp_path / "run" / TABLE).read_text()
    assert "Ended by an error: planner=a: 2 of 4 episodes, the first: RequestRefused" in table
    assert "context of 800" in table


def test_sweep_prints_the_warnings_of_its_tasks_once(tmp_path):
    make_planner(tmp_path / "a.gguf", "llama3", seed=1)
    task = '{"id": "t", "kind": "simple", "scene": "kitchen_1", "subtasks": [{"instruction": "x"'
    (tmp_path / "t.jsonl").write_text(task + ', "goals": ["TOGGLEOFF(Microwave)"]}]}\n')
    (tmp_path / "x.toml").write_text(
        'name = "x"\ntasks = "t.jsonl"\n[[rows]]\nname = "e"\nmethod = "expert"\n'
        '[[grid]]\nmodels.planner = "a.gguf"\nmodels.examples = [0, 1]\n'
    )
    shown = karma_eval(tmp_path / "x.toml", "--out", tmp_path / "run", "--workers", "1")
    assert shown.exit_code == 0, shown.output
    assert shown.output.count("already true at the start") == 1
