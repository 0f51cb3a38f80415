"""`karma doctor models`: what models run on, their memory and speed, and what would help."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from karma.bench.engine import model_doctor
from karma.cli import app
from karma.loading.models import Models
from karma.testing import make_picture_model, make_planner

EXPERIMENT = """
name = "x"
tasks = "tasks.jsonl"
[models]
planner = "{planner}"
vision = "{vision}"
threads = 2
profile = "full"
[[rows]]
name = "karma"
"""


@pytest.fixture(autouse=True)
def wide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")


def doctor(*arguments, code=0):
    """What the command prints, and the findings that it writes, by role."""
    asked = ["doctor", "models", *map(str, arguments), "--json", "out.json"]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == code, result.output
    found = json.loads(Path("out.json").read_text(encoding="utf-8"))
    return result.output, {one["role"]: one for one in found}


def test_shipped_models_tell_device_memory_speed_and_context():
    text, found = doctor()
    planner, embedder = found["planner"], found["embedder"]
    assert (planner["name"], planner["device"]) == ("karma-nano", "CPU")
    assert planner["how"] == "f16 KV, flash attention off, 1 thread"
    assert (planner["context"], planner["limit"]) == (1024, 2048)
    assert set(planner["speeds"]) == {"prefill tokens/s", "decode tokens/s"}
    assert all(rate > 0 for one in found.values() for rate in one["speeds"].values())
    assert (embedder["name"], embedder["device"], embedder["how"]) == ("minilm", "cpu", "float32")
    assert set(found) == {"planner", "embedder"}  # states from metadata: nothing is computed
    for words in ("karma-nano", "up to 2048", "decode tokens", "minilm"):
        assert words in text


def test_experiment_s_models_are_looked_at_and_options_go_before_its_own(tmp_path):
    planner = make_planner(tmp_path / "tiny.gguf")
    (tmp_path / "x.toml").write_text(EXPERIMENT.format(planner=planner, vision="nano-vlm"))
    text, found = doctor("x.toml", "--threads", 99, "--n-ctx", 1000)
    assert found["planner"]["name"] == "tiny"
    assert (found["planner"]["context"], found["planner"]["limit"]) == (1000, 1000)
    assert "99 threads" in found["planner"]["how"]
    assert "its context of 1000 does not hold" in text
    assert set(found["vision"]["speeds"]) == {"pictures/s"}


def test_planner_that_no_prompt_can_be_put_to_is_told(tmp_path):
    planner = make_planner(tmp_path / "tiny.gguf")
    text, found = doctor("--planner", planner, "--n-ctx", 512, code=1)
    assert "no request can be asked in the goals profile" in found["planner"]["error"]
    assert "--n-ctx" in text


def test_model_that_does_not_open_is_told_and_the_others_are_looked_at(tmp_path):
    text, found = doctor("--planner", tmp_path / "none.gguf", code=1)
    assert "does not open" in text
    assert "none.gguf" in found["planner"]["error"]
    assert found["embedder"]["speeds"]


def test_pair_of_gguf_files_tells_its_device_too(tmp_path):
    folder = make_picture_model(tmp_path / "pair", "llava").model.parent
    look = dict(model_doctor.examine(Models(vision=f"llama:{folder}")))[f"vision llama:{folder}"]
    seen = look()
    assert (seen.device, seen.how, seen.error) == ("CPU", "f16 KV", "")
    assert seen.speeds["pictures/s"] > 0
