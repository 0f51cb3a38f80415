"""Workers of a run: how many, one that dies, and what no cluster does."""

import os

import pytest
from support.run_files import ONLY, plant_plugin, write_experiment

from karma.bench.engine.run import Run
from karma.bench.engine.workers import suggest_workers
from karma.errors import WorkerLost
from karma.loading.models import Models
from karma.models.endpoint import Endpoint, Hosted

DEADLY = """
import os, signal
from karma.types.events import Outcome

class Deadly:
    name = "deadly"

    @classmethod
    def build(cls, resources, options):
        return cls()

    def begin(self, world, scene, *, seed, folder):
        self._folder = folder
        return self

    def do(self, subtask):
        mark = self._folder / "once"
        if "soap" in subtask.instruction or not mark.exists():
            mark.write_text("a worker was here")
            os.kill(os.getpid(), signal.SIGKILL)
        yield Outcome(finished=True, resident=(), handled_ids=())
"""


@pytest.fixture
def deadly(tmp_path, monkeypatch):
    """An installed method whose episodes kill their process: those with an apple, and one more."""
    place = tmp_path / "plugin"
    plant_plugin(place, "deadly", DEADLY, "methods", "deadly = deadly:Deadly")
    monkeypatch.syspath_prepend(str(place))


def test_worker_that_dies_is_replaced_and_its_episode_done_once_more(
    deadly, planner, tmp_path, caplog
):
    rows = '[[rows]]\nname = "deadly"\nmethod = "deadly"\n'
    path = write_experiment(tmp_path / "x.toml", planner, rows=rows, only=ONLY[:1], more="")
    (record,) = Run(path, tmp_path / "run").episodes(workers=2)
    assert (record.error, len(record.subtasks)) == ("", 2)
    assert "a worker was killed by SIGKILL" in caplog.text


def test_episode_that_kills_two_workers_ends_the_run_and_is_nobody_s_failure(
    deadly, planner, tmp_path
):
    rows = '[[rows]]\nname = "deadly"\nmethod = "deadly"\n'
    path = write_experiment(tmp_path / "x.toml", planner, rows=rows, only=ONLY[:2], more="")
    with pytest.raises(WorkerLost) as caught:
        list(Run(path, tmp_path / "run").episodes(workers=2))
    assert str(caught.value).startswith(
        "episode deadly/simple-14/0 cannot be done: 2 workers died of it, the last was killed by "
        "SIGKILL, as happens when memory runs out"
    )
    again = Run(path, tmp_path / "run")
    assert "simple-14" not in {record.task for record in again.records}
    assert not any(record.error for record in again.records)
    assert again.left > 0


def test_workers_that_wait_for_a_server_need_no_core_each(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr("karma.bench.engine.workers.available_mb", lambda: None)
    place = Endpoint(base_url="http://127.0.0.1:9/v1", model="m")
    models = Models(planner="openai", hosted=Hosted(planner=place))
    assert suggest_workers(models, 1000, in_flight=8).number == 8
    assert suggest_workers(models, 6, in_flight=8).number == 3
    assert suggest_workers(models, 1000).number == 2
    assert "8 requests in flight" in suggest_workers(models, 1000, in_flight=8).reason


@pytest.mark.parametrize(
    ("free_mb", "cores", "episodes", "number"),
    [(100_000, 4, 1000, 4), (100_000, 4, 14, 2), (100_000, 4, 3, 1), (1700, 4, 1000, 2),
     (300, 4, 1000, 1), (100_000, 1, 1000, 1)],
)  # fmt: skip
def test_workers_are_as_many_as_cores_memory_and_episodes_allow(
    monkeypatch, tmp_path, free_mb, cores, episodes, number
):
    (tmp_path / "meminfo").write_text(f"MemAvailable: {free_mb * 1_000_000 // 1024} kB\n")
    monkeypatch.setattr("karma.models.checks.memory.MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr("karma.models.checks.memory.CGROUP", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
    found = suggest_workers(Models(), episodes)
    assert found.number == number
    assert f"{cores} cores, {free_mb} MB free, about 650 MB each" in found.reason


def test_workers_that_use_more_threads_are_fewer(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(4)))
    monkeypatch.setattr("karma.bench.engine.workers.available_mb", lambda: None)
    assert suggest_workers(Models(threads=2), 1000).number == 2
