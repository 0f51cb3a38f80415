"""llama.cpp's eyes: pairs of GGUF files with random weights, whole and damaged."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.needs import need_models
from support.paths import ROOT
from support.sights import about, seen

from karma.bench.engine.run import Run
from karma.errors import ModelError, UnknownNameError
from karma.models.added import AddOptions, add_model
from karma.models.checks.gguf import check_projector
from karma.models.llama import vision as llama_vision
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.vision import LlamaVision, require_pictures
from karma.models.manifest import find_model, resolve_pair
from karma.registry import load
from karma.testing import PICTURE_FAMILIES, make_picture_model

ONE = LlamaOptions(threads=1)
MUG = seen("Mug|1")
DAMAGES = [  # family, and what is lost that llama.cpp ends the process over
    ("smolvlm", "v.blk.1.attn_q.weight"),
    ("llava", "vision.image_mean"),
    ("qwen2.5-vl", "vision.n_wa_pattern"),
]


def picture(seed):
    return np.random.default_rng(seed).integers(0, 256, (96, 128, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """Family -> folder with its two files."""
    root = tmp_path_factory.mktemp("pairs")
    return {name: make_picture_model(root / name, name).model.parent for name in PICTURE_FAMILIES}


def without(name, path):
    """Take a key or tensor away from a GGUF: what has another name is not there."""
    data, wanted = path.read_bytes(), name.encode()
    where = data.index(len(wanted).to_bytes(8, "little") + wanted) if "clip" in name else None
    where = data.index(wanted) if where is None else where + 8
    path.write_bytes(data[:where] + b"x" + data[where + 1 :])


def damaged(pairs, family, lost, folder):
    shutil.copytree(pairs[family], folder)
    found = resolve_pair(folder)
    without(f"clip.{lost}" if lost.startswith("vision") else lost, found.projector)
    return found


# ----------------------------------------------------------------- whole


@pytest.mark.parametrize("family", PICTURE_FAMILIES)
def test_every_picture_family_answers_another_picture_with_other_words(pairs, family, monkeypatch):
    monkeypatch.setattr(llama_vision, "MAX_TOKENS", 20)
    eyes = load("vision_models", "llama")(str(pairs[family]), llama_options=ONE)
    first, other, again = (eyes.answer(about(picture(seed)), max_tokens=12) for seed in (1, 2, 1))
    assert first == again != other
    assert eyes.read_states(picture(1), "wash the mug", [MUG]) == {}  # it babbles
    assert eyes.read_states(None, "wash the mug", []) == {}
    assert (eyes.name, eyes.needs_pictures) == (family, True)
    assert eyes.engine.threads == 1
    with pytest.raises(ModelError, match="there is none: nothing was rendered"):
        eyes.read_states(None, "wash the mug", [MUG])
    eyes.close()


def test_nothing_is_written_to_the_terminal_by_the_library(pairs):
    program = (
        "import sys, numpy as np\n"
        "from karma.types.observation import SeenObject\n"
        "from karma.models.llama import vision\n"
        "mug = SeenObject(object_id='Mug|1', object_type='Mug', position_m=(0, 0, 0),\n"
        "    box_center_m=(0, 0, 0), box_size_m=(1, 1, 1), pickupable=True)\n"
        "vision.MAX_TOKENS = 4\n"
        "eyes = vision.LlamaVision(sys.argv[1])\n"
        "kept = [eyes]  # to the end\n"
        "print(eyes.read_states(np.zeros((32, 32, 3), np.uint8), 'wash it', [mug]))\n"
    )
    command = [sys.executable, "-c", program, str(pairs["idefics3"])]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("{}\n", "")


@pytest.mark.model
def test_run_looks_through_a_pair_and_keeps_what_it_looked_at(pairs, tmp_path, monkeypatch):
    need_models("karma-nano")
    monkeypatch.setattr(llama_vision, "MAX_TOKENS", 4)  # it babbles on
    path = tmp_path / "x.toml"
    path.write_text(
        f'name = "x"\ntasks = "{ROOT / "eval/alfred_l/tasks.jsonl"}"\nonly = ["simple-12"]\n'
        f'[[rows]]\nname = "x"\n[models]\nvision = "llama:{pairs["smolvlm"]}"\n'
    )
    (record,) = Run(path, tmp_path / "run").episodes()
    assert record.error == ""
    assert list((tmp_path / "run").rglob("*.png"))  # it was asked


# ----------------------------------------------------------------- damaged


@pytest.mark.parametrize(("family", "lost"), DAMAGES)
def test_projector_that_ends_the_process_is_refused_by_a_trial(pairs, tmp_path, family, lost):
    pair = damaged(pairs, family, lost, tmp_path / "x")
    with pytest.raises(ModelError, match=r"cannot look at a picture by it .*\(code -?\d+\)"):
        llama_vision.try_pair(pair)


def test_cut_or_foreign_projector_is_a_model_error(pairs, tmp_path):
    shutil.copytree(pairs["llava"], tmp_path / "x")
    pair = resolve_pair(tmp_path / "x")
    data = pair.projector.read_bytes()
    for size in (0, 3, 20, 200, 2000, len(data) // 2, len(data) - 1):
        pair.projector.write_bytes(data[:size])
        with pytest.raises(ModelError, match=r"mmproj-llava\.gguf"):
            LlamaVision(tmp_path / "x")
    with pytest.raises(ModelError, match=r"llava\.gguf: .*clip|llava\.gguf: damaged"):
        check_projector(pair.model)


def test_folder_must_hold_a_model_and_its_projector_and_nothing_else(pairs, tmp_path):
    pair = resolve_pair(pairs["llava"])
    for files in ((), (pair.model,), (pair.projector,)):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        for file in files:
            shutil.copy(file, folder)
        with pytest.raises(ModelError, match=r"two \.gguf files, the model and its projector"):
            LlamaVision(folder)
    with pytest.raises(ModelError, match="no such folder"):
        LlamaVision(tmp_path / "nope")
    with pytest.raises(UnknownNameError, match="no model named 'nope'"):
        LlamaVision("nope")


def test_a_build_without_pictures_says_how_to_build_one(monkeypatch):
    monkeypatch.setattr(llama_vision, "has_pictures", lambda: False)
    with pytest.raises(ModelError, match=r"built without pictures[^$]*To fix: make setup"):
        LlamaVision("a")
    monkeypatch.undo()
    require_pictures()  # ours has them


# ----------------------------------------------------------------- the manifest


@pytest.fixture
def manifest(tmp_path, monkeypatch):
    (tmp_path / "models").mkdir()
    (tmp_path / "models/manifest.toml").write_text("")
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path / "models"))
    return tmp_path / "models/manifest.toml"


def test_added_pair_is_described_verified_and_opened_by_name(pairs, manifest, monkeypatch):
    folder = shutil.copytree(pairs["smolvlm"], manifest.parent / "smolvlm")
    added = add_model(folder, AddOptions(licence="MIT"))
    entry = find_model("smolvlm")
    assert added == entry
    assert (entry.role, entry.format, entry.chat) == ("vlm", "gguf", None)
    assert [Path(file.path).name for file in entry.files] == [
        "mmproj-smolvlm.gguf", "smolvlm.gguf",
    ]  # fmt: skip
    assert entry.memory_mb > 128
    monkeypatch.setattr(llama_vision, "try_pair", None)  # the manifest vouches
    monkeypatch.setattr(llama_vision, "MAX_TOKENS", 4)
    eyes = LlamaVision("smolvlm", llama_options=ONE)
    assert eyes.read_states(picture(1), "wash the mug", [MUG]) == {}
    eyes.close()
    projector = folder / "mmproj-smolvlm.gguf"
    projector.write_bytes(projector.read_bytes() + b"x")
    with pytest.raises(ModelError, match=r"mmproj-smolvlm\.gguf: it has \d+ bytes instead of"):
        LlamaVision("smolvlm")
