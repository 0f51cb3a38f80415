"""Where a GGUF is computed: devices found, layers placed, and an offloaded model at work."""

import subprocess
import sys
from pathlib import Path

import pytest
from support.paths import ROOT

from karma.errors import ModelError
from karma.models.checks.memory import Footprint
from karma.models.llama import opening as found
from karma.models.llama.opening import LlamaOptions, devices, memory_mb, place

SIZE = Footprint(  # 1,600 MB with 8,000 tokens, and 100 to compute
    file_mb=800, blocks=8, token_mb=0.1, words_mb=0, layer_mb=0, scores_mb=0, logits_mb=88
)


# ----------------------------------------------------------------- found


def test_cpu_is_found_and_is_no_gpu():
    (cpu,) = [one for one in devices() if one.name == "CPU"]
    assert (cpu.kind, cpu.is_gpu) == ("cpu", False)
    free, total = memory_mb(cpu)
    assert 0 < free <= total


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


def test_layers_that_do_not_fit_are_refused_with_the_number_that_does(monkeypatch):
    with pytest.raises(ModelError, match=r"gpu_layers = 6 do not fit, but 4 of 9 do.*\n.*= 4"):
        placed(monkeypatch, 900, gpu_layers=6)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"gpu_layers": -1}, "gpu_layers = -1"), ({"n_ctx": 0}, "n_ctx = 0"),
        ({"threads": 0}, "threads = 0"),
    ],
)  # fmt: skip
def test_option_that_cannot_be_is_refused_by_name(options, words):
    with pytest.raises(ModelError, match=words):
        LlamaOptions(**options)


# ----------------------------------------------------------------- at work


def test_offloaded_models_do_what_others_do():
    """The tests of offloaded.py, in a process of their own: llama.cpp forgets no device."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, Path(__file__).with_name("offloaded.py")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
