"""Episodes on a Ray cluster of two nodes on this machine; skipped where Ray is not installed.

pip install 'karma-offline[cluster]' && pytest tests/plugins/cluster/test_runs_ray.py
"""

import os
import signal
from dataclasses import replace

import pytest
from support.ray_cluster import two_nodes, workers_of
from support.run_files import ONLY, files, write_experiment

from karma.bench.engine.run import Run
from karma.errors import KarmaError, ModelError
from karma.journal.provenance import model_hashes, parts_of_planner
from karma.loading.models import Models

ray = pytest.importorskip("ray", reason="needs Ray: pip install 'karma-offline[cluster]'")

from karma.plugins.cluster.node import check_node, models_here  # noqa: E402
from karma.plugins.cluster.ray_cluster import host_of  # noqa: E402


@pytest.fixture(scope="module")
def cluster():
    with two_nodes() as address:
        yield address


def test_cluster_of_two_nodes_leaves_the_same_bytes_as_one_process(
    cluster, planner, tmp_path, caplog
):
    path = write_experiment(tmp_path / "x.toml", planner, only=ONLY[:2])
    assert len(list(Run(path, tmp_path / "one").episodes())) == 8
    run = Run(path, tmp_path / "ray")
    going = run.episodes(0, ray=cluster)
    next(going)
    going.close()  # stopped amid the work
    assert len(Run(path, tmp_path / "ray").records) == 1
    going = Run(path, tmp_path / "ray").episodes(0, ray=cluster)
    next(going)
    for process in workers_of(cluster):
        os.kill(process, signal.SIGKILL)
    assert len(list(going)) == 6
    assert "a worker was lost with its node or killed" in caplog.text
    assert files(tmp_path / "ray") == files(tmp_path / "one")


def test_node_that_has_another_model_is_named_with_what_differs(cluster, planner, tmp_path):
    path = write_experiment(tmp_path / "x.toml", planner, only=ONLY[:1])
    data = bytearray(planner.read_bytes())
    data[-1] ^= 1
    other = tmp_path / "tiny.gguf"
    other.write_bytes(data)
    path.write_text(path.read_text().replace(str(planner), str(other)))
    run = Run(path, tmp_path / "run2")
    other.write_bytes(planner.read_bytes())  # what the nodes find when they look
    with pytest.raises(KarmaError, match=r"node 127\.0\.0\.2: planner tiny: no model of SHA-256"):
        list(run.episodes(0, ray=cluster))
    assert not (tmp_path / "run2" / "episodes.jsonl").exists()


def test_address_without_a_cluster_is_refused_with_the_fix(planner, tmp_path):
    path = write_experiment(tmp_path / "x.toml", planner, only=ONLY[:1])
    run = Run(path, tmp_path / "run")
    with pytest.raises(KarmaError, match="is on another machine, and this run is offline"):
        list(run.episodes(0, ray="192.0.2.1:6379"))
    with pytest.raises(KarmaError, match=r"'here' is no address.*\n.*--ray HOST:PORT"):
        list(run.episodes(0, ray="here"))


@pytest.mark.parametrize("address", ["x", ":1", "x:", "ray://x", "x:port"])
def test_text_that_is_no_address_is_refused(address):
    with pytest.raises(KarmaError, match="is no address of a Ray cluster"):
        host_of(address)


@pytest.mark.model
def test_planner_is_found_by_its_hash_under_whatever_name(tmp_path):
    """A file that the manifest knows under another name is that model."""
    hashes = model_hashes(Models())
    name, sha256, _ = parts_of_planner(hashes["planner"])
    elsewhere = Models(planner=str(tmp_path / "not-here.gguf"))
    wanted = {**hashes, "planner": f"mine {sha256}"}
    assert models_here(elsewhere, wanted).planner == name
    with pytest.raises(ModelError, match="no model of SHA-256 0000"):
        models_here(elsewhere, {**hashes, "planner": f"mine {'0' * 64}"})


def test_node_with_another_version_prompt_or_scene_is_refused_by_name(planner, tmp_path):
    path = write_experiment(tmp_path / "x.toml", planner, only=ONLY[:1])
    run = Run(path, tmp_path / "run")
    header, models = run.header, run.experiment.models
    check_node(header, models, {})
    for change, said in (
        ({"versions": {**header.versions, "numpy": "0"}}, "versions: numpy: 0 became"),
        ({"prompts": {}}, "prompts: full_changing.txt: none became"),
        ({"scenes": dict.fromkeys(header.scenes, "x")}, "scenes: bedroom_1: x became"),
    ):
        with pytest.raises(KarmaError, match=said):
            check_node(replace(header, **change), models, {})
