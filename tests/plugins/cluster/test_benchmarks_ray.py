"""Benchmarks on a Ray cluster whose nodes have data of their own; skipped where Ray is missing.

pip install 'karma-offline[cluster]' && pytest tests/plugins/cluster/test_benchmarks_ray.py
"""

import json
import os
from importlib import metadata

import msgspec
import pytest
from support import alfred_kitchen as ours
from support import eb_alfred as eb
from support.eb_alfred import run_files
from support.ray_cluster import two_nodes
from support.run_files import plant_plugin
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma.bench.engine.run import Run
from karma.cli import app
from karma.errors import KarmaError, WorkerLost
from karma.journal.folder import EPISODES, HEADER
from karma.plugins.alfred.suites.experiment import EbExperiment
from karma.plugins.cluster.node import DataFolders, with_places_here

pytest.importorskip("ray", reason="needs Ray: pip install 'karma-offline[cluster]'")

LIVED = """
name = "tiny"
benchmark = "lived"
homes = 1
days = 1
requests = 4
first_home = 70
settings = [{ name = "usual", rooms = [2] }]
rows = [{ name = "ours", design = "ours" }, { name = "none", design = "none" }]
"""
EB = """
name = "x"
benchmark = "eb_alfred"
tasks = "../shared/data/eb/splits.json"
types = "../shared/data/eb/types.json"
trials = "../shared/data/eb/trials.jsonl"
"""
DEADLY = '''
"""A benchmark whose chains kill who plays them: the first of all once, those named "always"."""

import os, signal
from dataclasses import dataclass
from pathlib import Path

import msgspec
from karma.loading.models import Models
from karma.bench.figures.tables import Sheet
from karma.bench.engine.suite import BenchmarkResults, Chain


class Experiment(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    benchmark: str
    mark: str
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)
    plans: bool = False


@dataclass(frozen=True, kw_only=True)
class Record:
    row: str
    task: str
    seed: int
    success: bool
    end: str


class Deadly:
    experiment_kind, record_kind = Experiment, Record

    def __init__(self, experiment, path):
        self._mark = Path(experiment.mark)

    def chains(self):
        return [Chain(row="r", tasks=(task,), seed=0) for task in ("once", "always", "never")]

    def files(self):
        return []

    def begin(self, session):
        def play(chain):
            task = chain.tasks[0]
            if task == "always" or (task == "once" and not self._mark.exists()):
                self._mark.write_text("a worker was here")
                os.kill(os.getpid(), signal.SIGKILL)
            yield Record(row="r", task=task, seed=0, success=True, end="played")
        return play

    def results(self, records):
        done = tuple((one.task, one.end) for one in records)
        table = Sheet(title="", caption="", head=("task", "end"), lines=done)
        return BenchmarkResults(figures=[], table=table)
'''


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """A folder with an installed benchmark, `deadly`."""
    place = tmp_path_factory.mktemp("plugin")
    point = "deadly = deadly_benchmark:Deadly"
    return plant_plugin(place, "deadly_benchmark", DEADLY, "benchmarks", point)


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    """The reference data of the nodes; it is not where the run has its own."""
    return tmp_path_factory.mktemp("nodes") / "ref"


@pytest.fixture(scope="module")
def cluster(theirs, plugin):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KARMA_SHARED", str(theirs))
        patch.setenv("PYTHONPATH", f"{plugin}:{os.environ.get('PYTHONPATH', '')}")
        with two_nodes() as address:
            yield address


def write_data(shared):
    """Reference data with our kitchen; its demonstration, lists and room."""
    data = ours.reference(shared) / "data"
    (data / "eb").mkdir(exist_ok=True)
    eb.types_file(data / "eb")
    ours.write(data / "eb/trials.jsonl", ours.trial())
    told = [
        {"task": "x/ours_1", "repeat_idx": number, "instruction": text}
        for number, text in enumerate(("Cool some fruit.", "Put the apple into the fridge."))
    ]
    (data / "eb/splits.json").write_text(json.dumps({"base": told}))


@pytest.fixture
def eb_run(tmp_path, monkeypatch, theirs):
    """A function that opens a run of EB-ALFRED; its file lies on this machine only."""
    for shared in (theirs, tmp_path / "ref"):
        write_data(shared)
    monkeypatch.setenv("KARMA_SHARED", str(tmp_path / "ref"))
    path = tmp_path / "x.toml"

    def opened(name, rows=eb.ROWS, **more):
        path.write_text(EB + rows)
        return Run(path, tmp_path / name, **more)

    return opened


def lived(tmp_path, name):
    path = tmp_path / "homes.toml"
    path.write_text(LIVED)
    return Run(path, tmp_path / name)


def test_lived_homes_leave_the_same_bytes_with_one_worker_and_on_a_cluster(cluster, tmp_path):
    assert len(list(lived(tmp_path, "a").episodes())) == 2
    told = ["eval", str(tmp_path / "homes.toml"), "--out", str(tmp_path / "b"), "--ray", cluster]
    done = CliRunner().invoke(app, told)
    assert done.exit_code == 0, done.output
    assert f"on the Ray cluster at {cluster}: as many workers as it has room for" in done.output
    assert "2 of 2: " in done.output
    assert run_files(tmp_path / "a") == run_files(tmp_path / "b")
    assert (tmp_path / "a" / HEADER).read_bytes() == (tmp_path / "b" / HEADER).read_bytes()


def test_chain_that_kills_its_workers_is_done_again_and_then_ends_the_run(
    cluster, plugin, tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(str(plugin))
    assert "deadly" in metadata.entry_points(group="karma.benchmarks").names
    path = tmp_path / "x.toml"
    path.write_text(f'name = "x"\nbenchmark = "deadly"\nmark = "{tmp_path / "mark"}"\n')
    run = Run(path, tmp_path / "run")
    cause = "2 workers died of it, the last was lost with its node or killed"
    with pytest.raises(WorkerLost, match=f"r/always/0 cannot be done: {cause}"):
        list(run.episodes(1, ray=cluster))
    again = Run(path, tmp_path / "run")
    assert [(one.task, one.end) for one in again.records] == [("once", "played")]


def test_nodes_find_their_own_files_for_an_experiment_that_only_this_machine_has(cluster, eb_run):
    whole = eb_run("one")
    assert len(list(whole.episodes())) == 6
    run = eb_run("ray")
    (run.folder.parent / "x.toml").unlink()
    list(run.episodes(0, ray=cluster))
    assert run_files(run.folder) == run_files(whole.folder)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("eb/splits.json", r"files: splits\.json: [0-9a-f]{12} became [0-9a-f]{12}$"),
        ("alfred/layouts.json.gz", r"files: layouts\.json\.gz: [0-9a-f]{12} became none$"),
        ("eb/trials.jsonl", r"ref/data/eb/trials\.jsonl"),
    ],
)
def test_node_with_other_data_is_refused_by_the_names_of_its_files(
    cluster, eb_run, theirs, name, said
):
    run = eb_run("run")
    other = theirs / "data" / name
    if name.endswith("splits.json"):
        other.write_text(other.read_text() + "\n")
    else:
        other.unlink()
    with pytest.raises(KarmaError, match=rf"(?s)^node 127\.0\.0\.2: .*{said}"):
        list(run.episodes(0, ray=cluster))
    assert not (run.folder / EPISODES).exists()


def test_node_with_another_version_is_refused_by_its_name(cluster, tmp_path, monkeypatch):
    info = tmp_path / "only-here" / "faiss_cpu-0.0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: faiss-cpu\nVersion: 0.0.1\n")
    monkeypatch.syspath_prepend(str(info.parent))
    run = lived(tmp_path, "run")
    with pytest.raises(
        KarmaError, match=r"^node 127\.0\.0\.2: .*\n  versions: faiss-cpu: 0\.0\.1 "
    ):
        list(run.episodes(1, ray=cluster))


def test_node_without_the_planner_is_refused_and_with_it_plays_the_same(
    cluster, eb_run, tmp_path, theirs
):
    rows = '[[rows]]\nname = "tiny"\nprompt = { examples = 0, max_tokens = 8 }\n[models]\n'
    planner = export_tiny(tmp_path / "ref/tiny.gguf")
    said = rows + 'planner = "../shared/tiny.gguf"\nn_ctx = 4096\n'
    run = eb_run("ray", said)
    with pytest.raises(KarmaError, match=r"node 127\.0\.0\.2: planner tiny: no model of SHA-256"):
        list(run.episodes(0, ray=cluster))
    (theirs / "tiny.gguf").write_bytes(planner.read_bytes())
    assert len(list(run.episodes(0, ray=cluster))) == 2
    assert any(record.answers for record in run.records)
    whole = eb_run("one", said)
    list(whole.episodes())
    assert run_files(run.folder) == run_files(whole.folder)


def test_paths_below_the_folders_of_another_machine_are_those_of_this_one(monkeypatch):
    monkeypatch.setenv("KARMA_SHARED", "/here/ref")
    there = DataFolders(ours="/there/eval", shared="/there/ref")
    said = {
        "name": "x", "benchmark": "eb_alfred", "rows": [{"name": "r"}],
        "tasks": "/there/ref/data/a.json", "types": "/there/eval/b/types.json",
        "trials": "/there/reference/c.jsonl", "models": {"planner": "/there/ref/p.gguf"},
    }  # fmt: skip
    found = with_places_here(msgspec.convert(said, EbExperiment), there)
    assert found.tasks == "/here/ref/data/a.json"
    assert found.types == str(DataFolders.here().ours / "b/types.json")
    assert found.trials == "/there/reference/c.jsonl"  # in none of them
    assert found.models.planner == "/here/ref/p.gguf"
