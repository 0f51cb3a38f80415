"""What a model is said to take, against what a process that opens it is seen to take."""

import json
import subprocess
import sys

import pytest

from karma.models.checks.gguf import check_gguf
from karma.models.checks.memory import Footprint, gguf_parts_mb
from karma.testing import Size, make_planner

TAKEN = """
import hashlib, json, sys
from pathlib import Path
import llama_cpp
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.opening import LlamaOptions

def resident():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) * 1024 / 1e6

path, context = Path(sys.argv[1]), int(sys.argv[2])
sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
llama_cpp.llama_backend_init()
before = resident()
options = LlamaOptions(n_ctx=context, threads=1)
model = GgufModel(path, options, sha256=sha256)
model.evaluate([[300] * (context - 8), [301]])
print(json.dumps(resident() - before))
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    size = Size(
        layers=3, width=512, heads=8, kv_heads=8, feed_forward=2048, vocabulary=100_000, tied=True
    )
    return make_planner(tmp_path_factory.mktemp("made") / "large.gguf", size=size)


@pytest.mark.parametrize("context", [512, 1536])
def test_opened_model_takes_what_was_predicted(path, context):
    command = [sys.executable, "-c", TAKEN, str(path), str(context)]
    taken = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    predicted = gguf_parts_mb(path, check_gguf(path), context=context, batch=512)
    assert predicted == pytest.approx(taken, rel=0.1)


def test_gpu_that_gives_all_that_is_reserved_takes_a_batch_of_logits(path):
    size = Footprint.of(path, check_gguf(path), batch=512)
    assert size.logits_mb == pytest.approx(4 * 512 * 100_000 / 1e6)
    assert size.work_mb(512, on_gpu=True) > size.logits_mb > size.work_mb(512)
