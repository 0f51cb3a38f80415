"""Where a GGUF is computed: devices found, layers placed, and an offloaded model at work.

The GPU is llama.cpp's RPC device on this machine, see `support.rpc_device`. Not covered: a card.
"""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.paths import ROOT
from support.rpc_device import rpc_device, start
from typer.testing import CliRunner

from karma.cli import app
from karma.contracts import ProgramSpec, Prompt, Skill
from karma.errors import KarmaError, ModelError
from karma.infer.checks.memory import Footprint
from karma.infer.llama import devices as found
from karma.infer.llama.devices import add_remote, devices, memory_mb, place
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.llama.room_states import StateOptions
from karma.infer.programs.automaton import ProgramAutomaton
from karma.testing import make_llama

SIZE = Footprint(  # 1,600 MB with 8,000 tokens, and 100 to compute
    file_mb=800, blocks=8, token_mb=0.1, words_mb=0, layer_mb=0, scores_mb=0, logits_mb=88
)
PROMPT = Prompt(stable="#areas\nnode_1 Fridge Sink\n" * 12, changing="#task go\n#program\n")
SPEC = ProgramSpec(
    skills=(Skill(name="GoToObject", arguments=("object",)),),
    objects=("Apple", "Fridge"), max_calls=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def gpu():
    return rpc_device()


@pytest.fixture(scope="module")
def gguf(tmp_path_factory):
    return make_llama(
        tmp_path_factory.mktemp("m") / "made.gguf", layers=4, width=256, heads=4, kv_heads=2,
        feed_forward=512, vocabulary=600,
    )  # fmt: skip


def opened(path, *, states=None, **options):
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    chosen = LlamaOptions(**{"threads": 1, **options})
    return LlamaModel(path, sha256=sha256, options=chosen, states=states)


# ----------------------------------------------------------------- found


def test_cpu_is_found_and_is_no_gpu():
    (cpu,) = [one for one in devices() if one.name == "CPU"]
    assert (cpu.kind, cpu.is_gpu, cpu.address) == ("cpu", False, "")
    free, total = memory_mb(cpu)
    assert 0 < free <= total


def test_remote_device_is_found_once_and_tells_its_memory(gpu):
    names = add_remote(gpu.address)
    assert add_remote(gpu.address) == names
    (one,) = [one for one in devices() if one.name in names]
    assert (one.kind, one.is_gpu, one.address) == ("gpu", True, gpu.address)
    assert memory_mb(one)[0] > 0


def test_remote_device_whose_server_is_gone_is_listed_without_memory_and_ends_nothing():
    """In a process of its own: a device stays registered, and llama.cpp asks all that it knows."""
    program = (
        "from support.rpc_device import start\n"
        "from karma.infer.llama.devices import add_remote, devices, memory_mb\n"
        "device, process = start()\n"
        "names = add_remote(device.address)\n"
        "process.kill(); process.wait()\n"
        "print([memory_mb(one) for one in devices() if one.name in names])\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT / "tests")},
    )  # fmt: skip
    assert said.stdout == "[None]\n"


@pytest.mark.parametrize(
    "address, words",
    [
        ("127.0.0.1", "not HOST:PORT"), ("127.0.0.1:x", "not HOST:PORT"),
        ("127.0.0.1:1", "nobody answers there\n  To fix: start llama.cpp's rpc-server"),
    ],
)  # fmt: skip
def test_address_without_a_device_is_refused(address, words):
    with pytest.raises(ModelError, match=words):
        add_remote(address)


def test_remote_device_on_another_machine_needs_leave():
    with pytest.raises(KarmaError, match=r"RPC device at '192\.0\.2\.1' .*offline"):
        add_remote("192.0.2.1:50052")


# ----------------------------------------------------------------- placed


def placed(monkeypatch, free_mb, *, kinds=("gpu",), context=8000, **options):
    """Where SIZE goes on GPUs with so much free memory; None: they do not tell."""
    cards = tuple(
        found.Device(name=f"CUDA{n}", kind=kind, description="a card")
        for n, kind in enumerate(kinds)
    )
    cpu = found.Device(name="CPU", kind="cpu", description="")
    told = None if free_mb is None else (free_mb + found._SPARE_MB, 9e9)
    monkeypatch.setattr(found, "devices", lambda: (*cards, cpu))
    monkeypatch.setattr(found, "memory_mb", lambda _: told)
    return place("m", SIZE, LlamaOptions(**options), context=context)


@pytest.mark.parametrize(
    "free_mb, options, layers",
    [
        (None, {}, 9), (1700, {}, 9), (1699, {}, 7), (900, {}, 4), (120, {}, 0), (0, {}, 0),
        (9999, {"gpu_layers": 0}, 0), (9999, {"gpu_layers": 5}, 5), (9999, {"gpu_layers": 99}, 9),
    ],
)  # fmt: skip
def test_as_many_layers_go_on_the_gpu_as_fit_or_as_are_asked_for(
    monkeypatch, free_mb, options, layers
):
    where = placed(monkeypatch, free_mb, **options)
    assert (where.layers, where.name) == (layers, "CUDA0" if layers else "CPU")


def test_several_gpus_are_used_together_and_an_integrated_one_only_alone(monkeypatch):
    assert placed(monkeypatch, 9999, kinds=("gpu", "gpu")).name == "CUDA0+CUDA1"
    assert placed(monkeypatch, 9999, kinds=("integrated", "gpu")).name == "CUDA1"
    assert placed(monkeypatch, 9999, kinds=("integrated",)).name == "CUDA0"


def test_layers_that_do_not_fit_are_refused_with_the_number_that_does(monkeypatch):
    with pytest.raises(ModelError, match=r"gpu_layers = 6 do not fit, but 4 of 9 do.*\n.*= 4"):
        placed(monkeypatch, 900, gpu_layers=6)


def test_layers_asked_for_by_number_without_a_gpu_are_refused_with_how_to_build(gguf):
    with pytest.raises(ModelError, match=r"knows no GPU, only CPU\n.*make setup CMAKE_ARGS="):
        opened(gguf, gpu_layers=2)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"gpu_layers": -1}, "gpu_layers = -1"), ({"n_ctx": 0}, "n_ctx = 0"),
        ({"threads": 0}, "threads = 0"), ({"kv": "q4_0"}, "kv = 'q4_0': one of f16"),
        ({"flash_attention": "yes"}, "flash_attention = 'yes': one of auto"),
        ({"kv": "q8_0", "flash_attention": "off"}, "'q8_0' needs flash attention"),
    ],
)  # fmt: skip
def test_option_that_cannot_be_is_refused_by_name(options, words):
    with pytest.raises(ModelError, match=words):
        LlamaOptions(**options)


def test_kept_values_in_blocks_need_heads_that_blocks_fit_in(tmp_path):
    path = make_llama(
        tmp_path / "odd.gguf", layers=1, width=96, heads=2, kv_heads=1, feed_forward=64,
        vocabulary=600,
    )  # fmt: skip
    with pytest.raises(ModelError, match=r"heads of a multiple of 32 numbers, its have 48"):
        opened(path, kv="q8_0")


# ----------------------------------------------------------------- at work


def test_offloaded_model_has_its_weights_over_there_and_the_same_bits(gguf):
    gpu, _ = start()  # one that holds nothing yet
    before = gpu.memory_mb()
    there, here = opened(gguf, rpc=gpu.address, flash_attention="off"), opened(gguf)
    said, wanted = (one.complete(PROMPT, max_tokens=8) for one in (there, here))
    assert said.engine.device.startswith("RPC")
    assert (said.engine.gpu_layers, wanted.engine.gpu_layers) == (5, 0)
    assert wanted.engine.device == "CPU"
    assert gpu.memory_mb() - before > 0.9 * gguf.stat().st_size / 1e6
    assert said.text == wanted.text
    assert np.array_equal(there.gguf.logits(), here.gguf.logits())
    there.close()


def test_flash_attention_is_on_by_itself_on_a_gpu_only(gpu, gguf):
    there, here = opened(gguf, rpc=gpu.address, gpu_layers=2), opened(gguf)
    for model in (there, here):
        model.complete(PROMPT, max_tokens=1)
    assert (there.gguf.engine.flash_attention, here.gguf.engine.flash_attention) == (True, False)
    assert there.gguf.engine.gpu_layers == 2
    assert np.abs(there.gguf.logits() - here.gguf.logits()).max() < 0.2
    assert opened(gguf, kv="q8_0").complete(PROMPT, max_tokens=1).engine.flash_attention
    there.close()


def test_constrained_answers_of_an_offloaded_model_are_programs(gpu, gguf):
    model, automaton = opened(gguf, rpc=gpu.address), ProgramAutomaton(SPEC)
    for seed in range(20):
        text = model.complete(PROMPT, spec=SPEC, temperature=1.0, seed=seed).text
        assert automaton.accepts(automaton.advance(automaton.start(), text))
    model.close()


def test_offloaded_model_scores_and_grows(gpu, gguf):
    there, here = opened(gguf, rpc=gpu.address, flash_attention="off"), opened(gguf)
    texts = ["GoToObject(robot, 'Apple')\n", "GoToObject(robot, 'Fridge')\n", ""]
    long = (PROMPT.stable * 4, PROMPT.changing)
    for prompt in ((PROMPT.stable, PROMPT.changing), long):
        one, other = (model.choose(prompt, texts) for model in (there, here))
        assert one.number == other.number
        assert one.score == pytest.approx(other.score, abs=1e-3)
    there.complete(Prompt(stable=long[0], changing=long[1]), max_tokens=4)
    assert there.gguf.n_ctx > 512
    there.close()


def test_state_of_a_room_is_saved_on_a_device_and_loaded_to_it(gpu, gguf, tmp_path):
    states = StateOptions(folder=tmp_path)
    answers = []
    for source in ("evaluated", "loaded"):
        model = opened(gguf, rpc=gpu.address, states=states)
        found = model.complete(PROMPT, max_tokens=8)
        answers.append((found.text, model.gguf.logits().tobytes()))
        assert found.state == source
        model.close()
    assert answers[0] == answers[1]
    assert opened(gguf, states=states).complete(PROMPT, max_tokens=8).state == "evaluated"


def test_eval_on_a_device_records_it_and_names_it_in_the_header(gpu, tmp_path):
    (tmp_path / "one.toml").write_text(
        f'name = "one"\ntasks = "{ROOT}/eval/alfred_l/tasks.jsonl"\nonly = ["simple-02"]\n'
        '[[rows]]\nname = "karma"\n'
    )
    command = ["eval", tmp_path / "one.toml", "--out", tmp_path / "run", "--rpc", gpu.address]
    done = CliRunner().invoke(app, [str(one) for one in [*command, "--workers", 1]])
    assert done.exit_code == 0, done.output
    (timing,) = map(json.loads, (tmp_path / "run" / "timings.jsonl").read_text().splitlines())
    engines = [answer["engine"] for sub in timing["subtasks"] for answer in sub["answers"]]
    assert {(one["device"][:3], one["gpu_layers"]) for one in engines} == {("RPC", 7)}
    header = json.loads((tmp_path / "run" / "header.json").read_text())
    assert any(one.startswith("CPU: ") for one in header["machine"]["devices"])
    refused = CliRunner().invoke(app, [str(one) for one in [*command, "--kv", "q4_0"]])
    assert refused.exit_code == 1
    assert "q4_0" in refused.output
    assert Path(tmp_path / "run").exists()
