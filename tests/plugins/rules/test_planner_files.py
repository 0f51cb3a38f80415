"""Which planners may refuse, and whose words file is read for hints."""

import hashlib
import shutil

import pytest

from karma import registry
from karma.errors import ModelError
from karma.loading.planner_files import may_refuse, reader_for, words_path
from karma.models.manifest import ModelEntry, ModelFile
from karma.plugins.rules.wording.hints import WordFile, write_words

WORDS = WordFile(
    types={"Cup": ("glass",), "Knife": ("knife",)}, deeds={"wash": ("wash",)},
    phrases=frozenset(("glass", "wash")), words=frozenset(),
)  # fmt: skip
OWN = ("planner.gguf", "words.json", "words.safetensors")
ENTRY = """
[[models]]
name = "{name}"
role = "planner"
format = "gguf"
licence = "MIT"
source = "here"
prompt_profile = "compact"
context_length = 64
{more}
files = [{files}]
"""


@pytest.fixture(scope="module")
def minilm():
    return registry.load("embedders", "minilm")()


@pytest.fixture(scope="module")
def made(minilm, tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    write_words(folder / "words.json", WORDS, minilm)
    (folder / "planner.gguf").write_bytes(b"abc")
    return folder


@pytest.fixture
def models(made, tmp_path, monkeypatch):
    """A folder of models: "learnt" may refuse and has words, "plain" neither."""
    folder = tmp_path / "models"
    shutil.copytree(made, folder)
    contents = {name: (folder / name).read_bytes() for name in OWN}
    files = ", ".join(
        f'{{ path = "{name}", sha256 = "{hashlib.sha256(data).hexdigest()}", bytes = {len(data)} }}'
        for name, data in contents.items()
    )
    learnt = 'refuses = true\nwords = "words.json"'
    (folder / "manifest.toml").write_text(
        ENTRY.format(name="learnt", more=learnt, files=files)
        + ENTRY.format(name="plain", more="", files=files)
    )
    monkeypatch.setenv("KARMA_MODELS", str(folder))
    return folder


def test_planner_of_the_manifest_may_refuse_if_it_has_learnt_to_or_is_told_so(models):
    assert (may_refuse("learnt"), may_refuse("plain")) == (True, False)
    assert (may_refuse("learnt", said=False), may_refuse("plain", said=True)) == (False, True)


def test_planner_whose_entry_names_its_words_is_told_hints_and_another_none(models, minilm):
    (hint,) = reader_for("learnt", embedder=minilm).hints("wash the blade")
    assert (hint.phrase, hint.meanings[0].name) == ("blade", "Knife")
    assert reader_for("plain") is None


def test_words_file_that_is_not_what_the_manifest_says_is_refused(models):
    (models / "words.json").write_bytes(b"{}")
    with pytest.raises(ModelError, match=r"words\.json"):
        reader_for("learnt")


def test_words_file_that_is_none_of_its_model_is_refused():
    file = ModelFile(path="x.gguf", sha256="0" * 64, bytes=1)
    with pytest.raises(ValueError, match="none of its files"):
        ModelEntry(
            name="x", role="planner", format="gguf", files=(file,),
            licence="MIT", source="here", prompt_profile="compact", context_length=8,
            words="words.json",
        )  # fmt: skip


def test_gguf_without_an_entry_has_the_words_beside_it_or_none(made, tmp_path):
    assert words_path(str(made / "planner.gguf")) == made / "words.json"
    assert words_path(str(tmp_path / "reader.gguf")) is None
