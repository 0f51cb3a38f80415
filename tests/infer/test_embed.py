"""MiniLM from the installed package: unit rows, no network, the same bits in any company."""

import subprocess
import sys

import numpy as np
import pytest

from karma.errors import ModelError
from karma.infer.embed.sentence import FILES, MiniLm, SentenceEmbedder
from karma.infer.manifest.manifest import file_paths, find_model

TEXTS = ["apple", "red fruit", "a sofa in the living room", "", "apple", "ünïcödé 苹果", "x " * 600]


@pytest.fixture(scope="module")
def minilm():
    return MiniLm()


def test_embed_gives_unit_rows_in_order(minilm):
    rows = minilm.embed(TEXTS)
    assert rows.shape == (len(TEXTS), minilm.dimension)
    assert rows.dtype == np.float32
    assert np.allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    assert np.array_equal(rows[0], rows[4])


def test_embed_nothing_gives_an_empty_matrix(minilm):
    assert minilm.embed([]).shape == (0, 384)


def test_embed_row_does_not_depend_on_its_company(minilm):
    together = minilm.embed(TEXTS)
    minilm._row.cache_clear()
    for text, row in zip(reversed(TEXTS), together[::-1], strict=True):
        assert np.array_equal(minilm.embed([text])[0], row)


def test_embed_agrees_with_the_batched_reference(minilm):
    expected = minilm._model.encode(
        TEXTS, batch_size=8, normalize_embeddings=True, show_progress_bar=False
    )
    assert np.abs(minilm.embed(TEXTS) - expected).max() < 1e-5


def test_embed_is_semantic(minilm):
    apple, fruit, sofa = minilm.embed(TEXTS[:3])
    assert apple @ fruit > apple @ sofa


def test_any_folder_of_sentence_transformers_gives_what_minilm_gives(minilm):
    folder = file_paths(find_model("minilm"))[0].parent
    for model in ("minilm", folder):
        assert np.array_equal(SentenceEmbedder(model).embed(TEXTS[:4]), minilm.embed(TEXTS[:4]))


def test_embed_leaves_torch_s_threads_alone(minilm):
    import torch

    before = torch.get_num_threads()
    minilm.embed(["one more text"])
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("content", [None, b"other weights"])
def test_missing_or_changed_weights_are_refused_before_loading(tmp_path, content):
    if content is not None:
        (tmp_path / "model.safetensors").write_bytes(content)
    with pytest.raises(ModelError) as caught:
        MiniLm(tmp_path)
    for part in ("model.safetensors", FILES["model.safetensors"], "pip install"):
        assert part in str(caught.value)


def test_importing_loads_nothing_heavy():
    program = (
        "import sys, karma.infer.embed.sentence, karma.infer.llama.model\n"
        "import karma.infer.llama.gguf_export, karma.infer.embed.clip\n"
        "import karma.infer.vision.grounded_sam, karma.infer.manifest.added_models\n"
        "import karma.infer.vision.transformers, karma.infer.hosted.vision\n"
        "heavy = {'torch', 'transformers', 'llama_cpp', 'sentence_transformers', 'gguf', 'openai',"
        " 'PIL', 'safetensors'}\n"
        "sys.exit(' '.join(heavy & set(sys.modules)) or 0)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
