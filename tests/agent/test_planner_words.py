"""Which words file a planner is told hints by."""

import hashlib
import shutil

import pytest

from karma import registry
from karma.agent.loading.planner_files import chosen_words, hints_for
from karma.errors import FileError, ModelError
from karma.infer.manifest.manifest import ModelEntry, ModelFile
from karma.language.hints import WordFile, write_words

FILE = WordFile(
    types={"Cup": ("glass",), "Knife": ("knife",)}, deeds={"wash": ("wash",)},
    phrases=frozenset(("glass", "wash")), words=frozenset(),
)  # fmt: skip
ENTRY = """
[[models]]
name = "reader"
role = "planner"
format = "gguf"
licence = "MIT"
source = "here"
prompt_profile = "compact"
context_length = 64
words = "words.json"
files = [
  { path = "reader.gguf", sha256 = "GGUF" },
  { path = "words.json", sha256 = "WORDS" },
  { path = "words.safetensors", sha256 = "VECTORS" },
]
"""


@pytest.fixture(scope="module")
def minilm():
    return registry.load("embedders", "minilm")()


@pytest.fixture(scope="module")
def made(minilm, tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    write_words(folder / "words.json", FILE, minilm)
    (folder / "reader.gguf").write_bytes(b"abc")
    return folder


@pytest.fixture
def models(made, tmp_path, monkeypatch):
    folder = tmp_path / "models"
    shutil.copytree(made, folder)
    text = ENTRY
    for name, mark in (("reader.gguf", "GGUF"), ("words.json", "WORDS"),
                       ("words.safetensors", "VECTORS")):  # fmt: skip
        text = text.replace(mark, hashlib.sha256((folder / name).read_bytes()).hexdigest())
    (folder / "manifest.toml").write_text(text)
    monkeypatch.setenv("KARMA_MODELS", str(folder))
    return folder


def test_planner_whose_entry_names_its_words_is_told_hints(models, minilm):
    hints = hints_for("reader", embedder=minilm)
    ((hint,),) = (hints("wash the blade"),)
    assert (hint.phrase, hint.meanings[0].name) == ("blade", "Knife")


def test_planner_whose_entry_names_no_words_is_told_none(models):
    text = (models / "manifest.toml").read_text().replace('words = "words.json"\n', "")
    (models / "manifest.toml").write_text(text)
    assert hints_for("reader") is None


def test_words_that_are_not_what_the_manifest_says_are_refused(models, minilm):
    (models / "words.json").write_bytes(b"{}")
    with pytest.raises(ModelError, match=r"words\.json"):
        hints_for("reader", embedder=minilm)


def test_words_file_that_is_named_stands_for_the_planner_s_own(models, made):
    assert chosen_words("reader") == models / "words.json"
    assert chosen_words("reader", str(made / "words.json")) == made / "words.json"
    assert chosen_words("reader", "none") is None


def test_gguf_without_an_entry_has_the_words_beside_it_or_none(made, tmp_path):
    assert chosen_words(str(made / "reader.gguf")) == made / "words.json"
    assert chosen_words(str(tmp_path / "reader.gguf")) is None


def test_words_file_that_is_missing_is_named(tmp_path, minilm):
    with pytest.raises(FileError, match=r"nowhere\.json"):
        hints_for("reader", str(tmp_path / "nowhere.json"), minilm)


def test_entry_whose_words_are_none_of_its_files_is_refused():
    with pytest.raises(ValueError, match="none of its files"):
        ModelEntry(
            name="a", role="planner", format="gguf", licence="", source="",
            files=(ModelFile(path="a.gguf"),), prompt_profile="compact", context_length=8,
            words="words.json",
        )  # fmt: skip
