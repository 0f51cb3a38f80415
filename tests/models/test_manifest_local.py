"""`karma models add` and `remove`: taken in whole and by hash, refused by name, nothing lost."""

import hashlib
import shutil
from pathlib import Path

import pytest
from support import tiny_models
from support.tiny import export_tiny
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import ModelError, UnknownNameError
from karma.loading.models import Models, Row
from karma.loading.names import check_models
from karma.models import added as added_models
from karma.models.added import AddOptions, add_model, remove_model
from karma.models.llama.model import LlamaModel
from karma.models.manifest import (
    check,
    find_model,
    read_local,
    read_manifest,
    resolve_folder,
    resolve_planner,
    verify,
)

OURS = """
[[models]]
name = "ours"
role = "planner"
format = "gguf"
licence = "Apache-2.0"
source = "trained here"
prompt_profile = "compact"
context_length = 64
files = [{ path = "ours.gguf", bytes = 3, sha256 = "HASH" }]
""".replace("HASH", hashlib.sha256(b"abc").hexdigest())


@pytest.fixture(scope="module")
def gguf(tmp_path_factory):
    return export_tiny(tmp_path_factory.mktemp("g") / "tiny-Q8.gguf")


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return tiny_models.save_clip(tmp_path_factory.mktemp("c"))


@pytest.fixture
def manifest(tmp_path, monkeypatch):
    folder = tmp_path / "models"
    folder.mkdir()
    monkeypatch.setenv("KARMA_MODELS", str(folder))
    (folder / "ours.gguf").write_bytes(b"abc")
    (folder / "manifest.toml").write_text(OURS)
    return folder / "manifest.toml"


def known(manifest, clip, *, wrong=None):
    """Enter the CLIP folder into the manifest as a model that somebody may bring."""
    rows = []
    for path in sorted(clip.iterdir()):
        data = b"other" if path.name == wrong else path.read_bytes()
        sha256 = hashlib.sha256(data).hexdigest()
        row = f'path = "weights/clip/{path.name}", bytes = {len(data)}, sha256 = "{sha256}"'
        rows.append(f"  {{ {row} }},")
    manifest.write_text(
        OURS + '[[models]]\nname = "clip"\nrole = "image-embedder"\nformat = "safetensors"\n'
        'licence = "MIT"\nsource = "https://example.org/clip"\nrevision = "abc"\nfiles = [\n'
        + "\n".join(rows) + "\n]\n"
    )  # fmt: skip


def everything(folder):
    """All files below a folder with their bytes."""
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# ------------------------------------------------------------------------------ taking in


def test_gguf_is_hashed_described_and_runs_where_it_is(manifest, gguf):
    added = add_model(gguf, AddOptions(licence="MIT"))
    entry = find_model("tiny-Q8")
    assert added == entry
    assert (entry.role, entry.format, entry.licence) == ("planner", "gguf", "MIT")
    assert (entry.context_length, entry.prompt_profile, entry.chat) == (4096, "full", None)
    assert entry.files[0].sha256 == hashlib.sha256(gguf.read_bytes()).hexdigest()
    assert entry.memory_mb > entry.files[0].bytes / 1e6 + 12
    (path,) = verify(entry)
    assert path == gguf
    assert check(entry).state == "ok"
    planner = resolve_planner("tiny-Q8")
    assert LlamaModel(planner.path, sha256=planner.sha256).name == "tiny-Q8"


def test_folder_without_a_name_in_the_manifest_is_described_by_its_config(manifest, clip, tmp_path):
    folder = tmp_path / "my-clip"
    shutil.copytree(clip, folder)
    (folder / "pytorch_model.bin").write_bytes(b"pickle")
    (folder / ".cache").mkdir()
    (folder / ".cache/x.json").write_text("{}")
    added = add_model(folder)
    assert (added.name, added.role) == ("my-clip", "image-embedder")
    assert {Path(file.path) for file in added.files} == {folder / p.name for p in clip.iterdir()}
    assert resolve_folder("my-clip", "image-embedder").path == folder


def test_model_of_the_manifest_is_recognised_by_its_weights(manifest, clip):
    known(manifest, clip)
    assert check(find_model("clip")).state == "absent"
    assert add_model(clip).name == "clip"
    entry = find_model("clip")
    assert (entry.licence, entry.revision) == ("MIT", "abc")
    assert check(entry).state == "ok"
    assert [entry.name for entry in read_manifest().models] == ["ours", "clip"]
    remove_model("clip")
    assert check(find_model("clip")).state == "absent"


# ------------------------------------------------------------------------------ refusing


def test_file_that_is_not_the_manifest_s_is_refused_by_name_before_it_is_parsed(
    manifest, clip, tmp_path, monkeypatch
):
    known(manifest, clip, wrong="config.json")
    before = everything(manifest.parent)
    for part in ("check_weights", "read_config", "check_gguf"):
        monkeypatch.setattr(added_models, part, None)  # a call would be another error
    with pytest.raises(ModelError, match=r"config\.json: not the file of model 'clip'") as caught:
        add_model(clip, AddOptions(name="clip"))
    for part in (hashlib.sha256(b"other").hexdigest(), "https://example.org/clip", "revision abc"):
        assert part in str(caught.value)
    assert everything(manifest.parent) == before


@pytest.mark.parametrize("name", ["m.bin", "m.pt", "m.onnx"])
def test_pickle_is_refused_by_name_as_a_file_and_as_a_folder(manifest, tmp_path, name):
    folder = tmp_path / "bad"
    folder.mkdir()
    (folder / name).write_bytes(b"\x80\x04")
    (folder / "config.json").write_text("{}")
    with pytest.raises(ModelError, match=f"{name}: not opened"):
        add_model(folder / name)
    with pytest.raises(ModelError, match=r"may hold code|no \.safetensors, no \.gguf"):
        add_model(folder)
    assert not (manifest.parent / "local.toml").exists()


@pytest.mark.parametrize("path", ["org/model", "x.gguf"])
def test_path_that_does_not_exist_is_no_name_of_a_hub(manifest, tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError, match="no such file or folder") as caught:
        add_model(path)
    assert "never looked up" in str(caught.value)


def test_damaged_files_are_refused_and_leave_nothing(manifest, gguf, clip, tmp_path):
    before = everything(manifest.parent)
    (tmp_path / "cut.gguf").write_bytes(gguf.read_bytes()[:-1])
    shutil.copytree(clip, tmp_path / "cut")
    (tmp_path / "cut/model.safetensors").write_bytes(b"x" * 100)
    for path in ("cut.gguf", "cut"):
        with pytest.raises(ModelError, match="damaged") as caught:
            add_model(tmp_path / path)
        assert str(caught.value).startswith(str(tmp_path / path))
    assert everything(manifest.parent) == before


def test_names_do_not_collide_and_do_not_leave_the_folder(manifest, gguf):
    add_model(gguf)
    with pytest.raises(ModelError, match="was added before"):
        add_model(gguf)
    with pytest.raises(ModelError, match="SHA-256"):  # it is another file than ours.gguf
        add_model(gguf, AddOptions(name="ours"))
    for name in ("../up", "a/b", "a\nb"):
        with pytest.raises(ModelError, match="is not a name"):
            add_model(gguf, AddOptions(name=name))


def test_remove_touches_only_what_was_added(manifest, gguf):
    add_model(gguf)
    with pytest.raises(ModelError, match=r"'ours' was not added, so it stays\. Added: tiny-Q8"):
        remove_model("ours")
    remove_model("tiny-Q8")
    assert gguf.is_file()
    assert not (manifest.parent / "local.toml").exists()
    assert (manifest.parent / "ours.gguf").read_bytes() == b"abc"
    with pytest.raises(ModelError, match="Added: nothing"):
        remove_model("tiny-Q8")


# ------------------------------------------------------------------------------ the command


def karma(*arguments, code=0):
    found = CliRunner().invoke(app, list(map(str, arguments)))
    assert found.exit_code == code, found.output
    return found.output


def test_commands_add_show_verify_and_remove(manifest, clip):
    known(manifest, clip)
    assert "– clip: not present" in karma("models", "verify")
    assert "https://example.org/clip at revision abc" in karma("models", "verify", "clip", code=1)
    assert "added clip (image-embedder" in karma("models", "add", clip)
    assert "✓ clip: 5 files as they must be" in karma("models", "verify", "clip")
    assert "removed clip" in karma("models", "remove", "clip")


# ------------------------------------------------------------------------------ tried before


def test_what_does_not_run_in_its_role_is_not_added(manifest, clip, monkeypatch, tmp_path):
    said = karma("models", "add", clip, "--name", "eyes", "--role", "vlm", code=1)
    assert "not added, since it was tried" in said
    assert "added eyes" not in said and "Traceback" not in said
    assert not read_local().models
    said = karma("models", "add", clip, "--name", "eyes", "--role", "vlm", "--untried")
    assert "added eyes" in said and "tried as" not in said


def test_model_is_found_by_its_name_alone_in_the_role_that_it_has(manifest, clip, monkeypatch):
    karma("models", "add", clip, "--name", "mysmol", "--role", "vlm", "--untried")
    karma("models", "add", clip, "--name", "myclip")
    assert Models(vision="mysmol").vision == "transformers:mysmol"
    assert Row(name="x", vision="mysmol").vision == "transformers:mysmol"
    assert Models(embedder="myclip").embedder == "clip:myclip"
    assert Models(embedder="clip").embedder == "clip"  # what is registered goes first
    with pytest.raises(ModelError, match="vision: model 'myclip' is not for role vlm"):
        check_models({"vision": Models(vision="myclip").vision})
    with pytest.raises(UnknownNameError, match="Did you mean 'mysmol'"):
        check_models({"vision": "mysmoll"})
