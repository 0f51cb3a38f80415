"""The manifest is read strictly, and files are checked before anything parses them."""

import hashlib
from typing import get_args

import pytest
from support.paths import ROOT

from karma.errors import FileError, ModelError
from karma.models.embed import minilm as embed
from karma.models.manifest import (
    ModelEntry,
    ModelFile,
    Role,
    check,
    find_model,
    read_manifest,
    read_shipped,
    resolve_folder,
    resolve_planner,
    verify,
)

SAFE = (".gguf", ".safetensors", ".json", ".txt", ".model", ".jinja")
DATA = b"weights"
SHA = hashlib.sha256(DATA).hexdigest()
ENTRY = f"""
[[models]]
name = "nano"
role = "planner"
format = "gguf"
licence = "Apache-2.0"
source = "trained here"
restore = "git restore models/nano"
prompt_profile = "compact"
context_length = 2048
files = [{{ path = "nano/nano.gguf", bytes = 7, sha256 = "{SHA}" }}]
"""
FOLDER = f"""
[[models]]
name = "folder"
role = "text-embedder"
format = "safetensors"
licence = "MIT"
source = "somewhere"
files = [
  {{ path = "f/1_Pooling/config.json", bytes = 7, sha256 = "{SHA}" }},
  {{ path = "f/model.safetensors", bytes = 7, sha256 = "{SHA}" }},
]
"""


@pytest.fixture
def manifest(tmp_path, monkeypatch):
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path))
    (tmp_path / "nano").mkdir()
    (tmp_path / "nano/nano.gguf").write_bytes(DATA)
    path = tmp_path / "manifest.toml"
    path.write_text(ENTRY)
    return path


def test_project_s_manifest_is_sound_and_its_minilm_is_the_one_the_code_loads():
    entry = find_model("minilm")
    verify(entry)
    hashes = {file.path.removeprefix("model/"): file.sha256 for file in entry.files}
    assert embed.FILES.items() <= hashes.items()
    assert (entry.package, entry.restore) == (embed.PACKAGE, embed.RESTORE)
    names = [entry.name for entry in read_manifest().models]
    assert len(names) == len(set(names))


def test_project_s_manifest_has_every_role_and_says_where_a_model_comes_from():
    models = read_shipped().models
    assert {entry.role for entry in models} == set(get_args(Role)), "a role nobody fills"
    for entry in models:
        assert entry.licence
        assert entry.memory_mb
        assert entry.package or entry.pieces or entry.revision or "card: cards/" in entry.source
        spacy = entry.format == "spacy"  # msgpack and JSON, of names of its own
        assert spacy or all(file.path.endswith(SAFE) for file in entry.files)


def test_every_key_and_role_of_the_manifest_is_in_its_page():
    page = (ROOT / "docs/models.md").read_text()
    for key in (*ModelEntry.__struct_fields__, *ModelFile.__struct_fields__, *get_args(Role)):
        assert f"`{key}`" in page, key
    for entry in read_shipped().models:
        assert f"`{entry.name}`" in page, entry.name


def test_absent_wrong_and_right_files_are_told_apart(manifest):
    entry, file = find_model("nano"), manifest.parent / "nano/nano.gguf"
    assert check(entry).state == "ok"
    file.write_bytes(b"other")
    assert check(entry).state == "wrong"
    file.unlink()
    assert check(entry).state == "absent"


def test_folder_is_a_verified_name_or_a_path(manifest):
    manifest.write_text(FOLDER)
    (manifest.parent / "f/1_Pooling").mkdir(parents=True)
    for file in ("f/model.safetensors", "f/1_Pooling/config.json"):
        (manifest.parent / file).write_bytes(DATA)
    found = resolve_folder("folder", "text-embedder")
    assert (found.name, found.path) == ("folder", manifest.parent / "f")
    assert resolve_folder(str(manifest.parent / "f"), "text-embedder").path == found.path
    with pytest.raises(ModelError, match="not for role vlm but for 'text-embedder'"):
        resolve_folder("folder", "vlm")
    with pytest.raises(ModelError, match="no such folder"):
        resolve_folder(manifest.parent / "g", "text-embedder")
    (manifest.parent / "f/1_Pooling/config.json").write_bytes(b"Weights")
    with pytest.raises(ModelError, match=r"1_Pooling/config\.json: its SHA-256"):
        resolve_folder("folder", "text-embedder")


@pytest.mark.parametrize(
    ("content", "reason"), [(None, "No such file"), (b"weight", "6 bytes"), (b"Weights", "SHA-256")]
)
def test_wrong_file_is_named_with_hash_and_command(manifest, content, reason):
    file = manifest.parent / "nano/nano.gguf"
    file.unlink()
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ModelError) as caught:
        verify(find_model("nano"))
    fix = ("git restore models/nano", "karma models verify")
    for part in (str(file), reason, f"Expected SHA-256: {SHA}", *fix):
        assert part in str(caught.value)


@pytest.mark.parametrize(("old", "new", "reason"), [
    ("licence", "license", "license"),
    ('"planner"', '"poet"', "poet"), ("name =", "# name =", "name"),
    ("prompt_profile", "# prompt_profile", "prompt_profile"), ("[{", "[[{", ""),
    ("source", "extra = 1\nsource", "extra"), ("bytes = 7", 'bytes = "7"', "bytes"),
    (SHA[:9], "ABC", "sha256"), ("nano/nano", "../nano", "'..'"),
    ("nano/nano", "/nano", "absolute"), ('name = "nano"', 'name = "a/b"', "a/b"),
])  # fmt: skip
def test_manifest_that_does_not_fit_is_refused_by_name(manifest, old, new, reason):
    manifest.write_text(ENTRY.replace(old, new, 1))
    with pytest.raises(FileError, match=r"manifest\.toml") as caught:
        read_manifest()
    assert reason in str(caught.value)


def test_planner_is_a_name_or_any_gguf_path(manifest, tmp_path):
    named = resolve_planner("nano")
    assert (named.name, named.sha256, named.prompt_profile) == ("nano", SHA, "compact")
    assert named.path.read_bytes() == DATA
    other = resolve_planner(str(tmp_path / "my.Model.gguf"))
    assert (other.name, other.sha256, other.prompt_profile) == ("my.Model", None, "full")
