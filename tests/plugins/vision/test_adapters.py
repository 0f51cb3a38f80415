"""Adapters over real files of the real architectures, with random weights made here.

They agree with transformers' own processors, give the same bits in any company, and refuse what
they should not open before a weight is loaded.
"""

import json
import pickle
import shutil

import numpy as np
import pytest
from support import tiny_models
from support.tiny_vision import save_family

from karma.errors import ModelError, UnknownNameError
from karma.models.checks import memory
from karma.plugins.vision.clip import ClipEmbedder
from karma.plugins.vision.sentence import SentenceEmbedder
from karma.plugins.vision.vlm import TransformersVision

TEXTS = ["apple", "The red mug, on a table!", "", "apple", "sofa " * 40, "ünïcödé 苹果"]
FRAMES = np.random.default_rng(0).integers(0, 256, (3, 40, 52, 3), dtype=np.uint8)
SAVE = {
    "clip": tiny_models.save_clip, "siglip": tiny_models.save_siglip,
    "sentence": tiny_models.save_sentence, "llava": lambda folder: save_family("llava", folder),
}  # fmt: skip


def opened(kind, folder):
    """The adapter of a kind over a folder."""
    if kind == "sentence":
        return SentenceEmbedder(folder)
    if kind in ("clip", "siglip"):
        return ClipEmbedder(folder)
    return TransformersVision(folder)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """One folder per architecture; not to be changed."""
    root = tmp_path_factory.mktemp("models")
    return {kind: save(_made(root / kind)) for kind, save in SAVE.items()}


def _made(folder):
    folder.mkdir()
    return folder


@pytest.fixture(scope="module")
def models(folders):
    return {kind: opened(kind, folder) for kind, folder in folders.items()}


@pytest.fixture
def copies(folders, tmp_path):
    """The same folders, to be spoiled."""
    for kind, folder in folders.items():
        shutil.copytree(folder, tmp_path / kind)
    return {kind: tmp_path / kind for kind in folders}


# ------------------------------------------------------------------------------ text and pictures


@pytest.mark.parametrize("kind", ["clip", "siglip", "sentence"])
def test_texts_become_unit_rows_that_do_not_depend_on_their_company(models, kind):
    rows = models[kind].embed(TEXTS)
    assert rows.shape == (len(TEXTS), models[kind].dimension)
    assert rows.dtype == np.float32
    assert np.allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    assert np.array_equal(rows[0], rows[3])
    assert not np.allclose(rows[0], rows[1])
    models[kind]._row.cache_clear()
    for text, row in zip(reversed(TEXTS), rows[::-1], strict=True):
        assert np.array_equal(models[kind].embed([text])[0], row)
    assert models[kind].embed([]).shape == (0, models[kind].dimension)


@pytest.mark.parametrize("kind", ["clip", "siglip"])
def test_pictures_become_unit_rows_of_the_same_space(models, kind):
    rows = models[kind].embed_images(list(FRAMES))
    assert rows.shape == (3, models[kind].dimension)
    assert np.allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    assert not np.allclose(rows[0], rows[1])
    assert np.array_equal(models[kind].embed_images([FRAMES[1]])[0], rows[1])
    assert models[kind].embed_images([]).shape == (0, models[kind].dimension)
    with pytest.raises(ValueError, match="uint8"):
        models[kind].embed_images([FRAMES[0].astype(np.float32)])


def test_clip_agrees_with_transformers_own_processor(models, folders):
    import torch
    from transformers import CLIPModel, CLIPTokenizer
    from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil

    model = CLIPModel.from_pretrained(folders["clip"], local_files_only=True).eval()
    words = CLIPTokenizer.from_pretrained(folders["clip"], local_files_only=True)
    pictures = CLIPImageProcessorPil.from_pretrained(folders["clip"], local_files_only=True)
    given = words(["apple red"], return_tensors="pt", truncation=True, max_length=20)
    seen = pictures(images=[FRAMES[0]], return_tensors="pt")
    with torch.no_grad():
        out = model(**given, **seen)
    pairs = [
        (out.text_embeds[0], models["clip"].embed(["apple red"])[0]),
        (out.image_embeds[0], models["clip"].embed_images([FRAMES[0]])[0]),
    ]
    for theirs, ours in pairs:
        assert np.abs(theirs.numpy() - ours).max() < 1e-6


def test_sentence_embedder_agrees_with_the_batched_reference(models):
    expected = models["sentence"]._model.encode(TEXTS, batch_size=8, normalize_embeddings=True)
    assert np.abs(models["sentence"].embed(TEXTS) - expected).max() < 1e-5


# ------------------------------------------------------------------------------ refusals


@pytest.mark.parametrize("kind", SAVE)
@pytest.mark.parametrize("name", ["org/model", "/no/such/folder"])
def test_name_that_is_no_folder_is_never_looked_up(kind, name, folders):
    with pytest.raises((UnknownNameError, ModelError)) as caught:
        opened(kind, name)
    assert name in str(caught.value)
    assert "karma models add PATH" in str(caught.value)


@pytest.mark.parametrize("kind", SAVE)
def test_wrong_architecture_is_named_before_weights_are_read(kind, copies, folders):
    path = copies[kind] / "config.json"
    config = json.loads(path.read_text())
    path.write_text(json.dumps({**config, "model_type": "gpt2"}))
    (copies[kind] / "model.safetensors").write_bytes(b"never read")
    with pytest.raises(ModelError, match=r"config\.json: model_type is 'gpt2', this adapter opens"):
        opened(kind, copies[kind])
    if kind != "sentence":  # any head will do for text
        path.write_text(json.dumps({**config, "architectures": ["CLIPTextModel"]}))
        with pytest.raises(ModelError, match="architecture CLIPTextModel, this adapter opens"):
            opened(kind, copies[kind])


@pytest.mark.parametrize("kind", SAVE)
def test_pickled_weights_are_not_opened(kind, copies):
    (copies[kind] / "model.safetensors").rename(copies[kind] / "pytorch_model.bin")
    with pytest.raises(ModelError, match=r"pytorch_model\.bin.*may hold code"):
        opened(kind, copies[kind])


@pytest.mark.parametrize("kind", SAVE)
@pytest.mark.parametrize("damage", ["cut", "flipped header", "list"])
def test_damaged_weights_are_an_error_that_names_them(kind, damage, copies, folders):
    path = copies[kind] / "model.safetensors"
    data = path.read_bytes()
    path.write_bytes({
        "cut": data[:-1],
        "flipped header": data[:60] + b"\xff\xff" + data[62:], "list": b"\2" + b"\0" * 7 + b"[]",
    }[damage])  # fmt: skip
    with pytest.raises(ModelError, match=r"model\.safetensors: damaged or not safetensors"):
        opened(kind, copies[kind])


@pytest.mark.parametrize("kind", SAVE)
def test_weights_that_lack_a_part_are_not_filled_with_random_numbers(kind, copies, folders):
    from safetensors.numpy import load_file, save_file

    path = copies[kind] / "model.safetensors"
    tensors = load_file(path)
    name = sorted(tensors)[0]
    save_file({key: value for key, value in tensors.items() if key != name}, path)
    with pytest.raises(ModelError, match=r"not a whole .* weights are missing, e\.g\."):
        opened(kind, copies[kind])


@pytest.mark.parametrize("kind", SAVE)
def test_too_little_memory_is_told_before_anything_is_loaded(
    kind, copies, folders, monkeypatch, tmp_path
):
    (tmp_path / "meminfo").write_text("MemTotal: 99 kB\nMemAvailable:      1000 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    with pytest.raises(ModelError, match=r"needs about 6. MB of memory .* 1 MB are free") as caught:
        opened(kind, copies[kind])
    assert "karma models list" in str(caught.value)


@pytest.mark.parametrize("kind", SAVE)
def test_code_beside_a_model_is_never_run(kind, copies, folders, tmp_path):
    """Neither remote code that a configuration asks for, nor a pickle beside the safetensors."""
    trap, folder = tmp_path / "sprung", copies[kind]
    (folder / "evil.py").write_text(f"open({str(trap)!r}, 'w')\nclass Evil: pass\n")
    asked = {f"Auto{what}": "evil.Evil" for what in ("Config", "Model", "ImageProcessor")}
    for file in ("config.json", "preprocessor_config.json", "tokenizer_config.json"):
        if (folder / file).exists():
            said = json.loads((folder / file).read_text())
            (folder / file).write_text(json.dumps({**said, "auto_map": asked}))
    (folder / "pytorch_model.bin").write_bytes(pickle.dumps(_Trap(trap)))
    try:
        opened(kind, folder)
    except ModelError as error:
        assert str(folder) in str(error)
    assert not trap.exists()
    pickle.loads((folder / "pytorch_model.bin").read_bytes())
    assert trap.exists()  # it would have gone off


class _Trap:
    """A pickle that makes a file when it is loaded."""

    def __init__(self, path):
        self._path = path

    def __reduce__(self):
        return open, (str(self._path), "w")


def test_shards_are_followed_and_a_missing_one_is_named(copies):
    from safetensors.numpy import load_file, save_file

    folder = copies["clip"]
    whole = ClipEmbedder(folder).embed(["apple"])
    tensors = load_file(folder / "model.safetensors")
    (folder / "model.safetensors").unlink()
    names, index = sorted(tensors), {}
    for number, part in enumerate((names[::2], names[1::2])):
        save_file({name: tensors[name] for name in part}, folder / f"m-{number}.safetensors")
        index.update(dict.fromkeys(part, f"m-{number}.safetensors"))
    where = folder / "model.safetensors.index.json"
    where.write_text(json.dumps({"metadata": {}, "weight_map": index}))
    sharded = ClipEmbedder(folder).embed(["apple"])  # kernels may round by where a weight lies
    assert np.allclose(sharded, whole, rtol=0.0, atol=1e-6)
    (folder / "m-1.safetensors").unlink()
    with pytest.raises(ModelError, match=r"m-1\.safetensors: missing"):
        ClipEmbedder(folder)
    where.write_text(json.dumps({"weight_map": {"a": "../m-0.safetensors"}}))
    with pytest.raises(ModelError, match="not a safetensors file of this folder"):
        ClipEmbedder(folder)
