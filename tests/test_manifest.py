"""The manifest is read strictly, and files are checked before anything parses them."""

import hashlib
from pathlib import Path

import pytest

from karma.errors import FileError, ModelError, UnknownNameError
from karma.infer import embed
from karma.infer.manifest import (
    check_file,
    file_paths,
    find_model,
    manifest_path,
    read_manifest,
    resolve_planner,
    verify,
)

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


@pytest.fixture
def manifest(tmp_path):
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


def test_project_s_shipped_files_are_what_the_manifest_says():
    for entry in read_manifest().models:
        assert verify(entry) == file_paths(entry)


def test_right_file_is_verified(manifest):
    entry = find_model("nano", manifest)
    assert verify(entry, manifest) == (manifest.parent / "nano/nano.gguf",)


@pytest.mark.parametrize(
    ("content", "reason"), [(None, "No such file"), (b"weight", "6 bytes"), (b"Weights", "SHA-256")]
)
def test_wrong_file_is_named_with_hash_and_command(manifest, content, reason):
    file = manifest.parent / "nano/nano.gguf"
    file.unlink()
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ModelError) as caught:
        verify(find_model("nano", manifest), manifest)
    fix = ("git restore models/nano", "karma models verify")
    for part in (str(file), reason, f"Expected SHA-256: {SHA}", *fix):
        assert part in str(caught.value)


def test_missing_package_is_named_with_the_command_that_installs_it(manifest):
    manifest.write_text(ENTRY.replace("files", 'package = "no_such_package"\nfiles'))
    with pytest.raises(ModelError, match="no_such_package") as caught:
        verify(find_model("nano", manifest), manifest)
    assert "git restore" in str(caught.value)


@pytest.mark.parametrize(("old", "new", "reason"), [
    ("licence", "license", "license"), ("bytes = 7, ", "", "bytes"),
    ('"planner"', '"poet"', "poet"), ("name =", "# name =", "name"),
    ("prompt_profile", "# prompt_profile", "prompt_profile"), ("[{", "[[{", ""),
    ("source", "extra = 1\nsource", "extra"), ("bytes = 7", 'bytes = "7"', "bytes"),
])  # fmt: skip
def test_manifest_that_does_not_fit_is_refused_by_name(manifest, old, new, reason):
    manifest.write_text(ENTRY.replace(old, new, 1))
    with pytest.raises(FileError, match=r"manifest\.toml") as caught:
        read_manifest(manifest)
    assert reason in str(caught.value)


def test_missing_manifest_says_how_to_point_to_it(tmp_path):
    with pytest.raises(FileError, match="KARMA_MODELS"):
        read_manifest(tmp_path / "manifest.toml")


def test_environment_moves_the_manifest(manifest, monkeypatch):
    assert manifest_path() == Path(__file__).parents[1] / "models/manifest.toml"
    monkeypatch.setenv("KARMA_MODELS", str(manifest.parent))
    assert [entry.name for entry in read_manifest().models] == ["nano"]


def test_planner_is_a_name_or_any_gguf_path(manifest, tmp_path):
    named = resolve_planner("nano", manifest)
    assert (named.name, named.sha256, named.prompt_profile) == ("nano", SHA, "compact")
    assert named.path.read_bytes() == DATA
    assert named.context_length == 2048
    other = resolve_planner(str(tmp_path / "my.Model.gguf"), manifest)
    assert (other.name, other.sha256, other.prompt_profile) == ("my.Model", None, "full")


def test_planner_unknown_name_suggests_the_nearest(manifest):
    with pytest.raises(UnknownNameError, match="Did you mean 'nano'"):
        resolve_planner("nanno", manifest)
    with pytest.raises(ModelError, match="not a planner"):
        resolve_planner("minilm")


def test_check_file_of_a_folder_is_a_model_error(tmp_path):
    with pytest.raises(ModelError, match="directory"):
        check_file(tmp_path, SHA)
