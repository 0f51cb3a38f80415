"""Files that end in .gguf and are no language model, and models under other names than theirs."""

import shutil

import gguf as format
import numpy as np
import pytest
from support.paths import ROOT

from karma.errors import ModelError
from karma.loading.names import check_models
from karma.models.added import add_model
from karma.models.checks.gguf import check_gguf
from karma.models.llama.model import LlamaModel
from karma.models.manifest import read_local, resolve_planner
from karma.testing import make_planner
from karma.testing.families import Size, language_keys, language_tensors
from karma.testing.models import add_keys, write_random_gguf

LLAMA = "llama"


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    return make_planner(tmp_path_factory.mktemp("m") / "tiny.gguf", "llama3")


@pytest.fixture
def manifest(tmp_path, monkeypatch):
    folder = tmp_path / "models"
    folder.mkdir()
    shutil.copy(ROOT / "models/manifest.toml", folder)
    monkeypatch.setenv("KARMA_MODELS", str(folder))
    return folder / "manifest.toml"


def written(path, architecture, fill):
    def whole(writer):
        add_keys(writer, language_keys(LLAMA, Size()))
        fill(writer)

    return write_random_gguf(path, architecture, whole, language_tensors(LLAMA, Size()), seed=0)


def no_vocabulary(model):
    def fill(writer):
        if model is not None:
            writer.add_tokenizer_model(model)

    return fill


def typed(kind):
    return lambda writer: writer.add_type(kind)


@pytest.mark.parametrize(
    ("architecture", "fill", "said"),
    [
        (LLAMA, no_vocabulary("none"), "it has no vocabulary"),
        (LLAMA, no_vocabulary(None), "it has no vocabulary"),
        (LLAMA, typed("adapter"), r"an adapter \(LoRA\).*\n  To fix: merge it"),
        ("clip", typed("mmproj"), "the picture part of a model"),
        ("nomic-bert", typed("model"), r"an embedder \(nomic-bert\)"),
    ],
)
def test_what_is_no_model_to_ask_says_what_it_is(manifest, tmp_path, architecture, fill, said):
    path = written(tmp_path / "other.gguf", architecture, fill)
    with pytest.raises(ModelError, match=said):
        check_gguf(path)
    with pytest.raises(ModelError, match=said):
        LlamaModel(path)
    with pytest.raises(ModelError):
        add_model(path)
    assert not read_local().models


@pytest.mark.parametrize("name", ["Tiny-Q4_K_M.gguf", "TINY.GGUF", "0f3c", "model.Q4"])
def test_a_gguf_is_told_by_its_first_bytes_and_named_by_its_link(
    manifest, planner, tmp_path, monkeypatch, name
):
    (tmp_path / "blobs").mkdir()
    (tmp_path / "snapshots").mkdir()
    shutil.copy(planner, tmp_path / "blobs" / "9a1b")
    link = tmp_path / "snapshots" / name
    link.symlink_to("../blobs/9a1b")
    added = add_model(link)
    assert added.name == name.rpartition(".")[0] or name
    assert resolve_planner(added.name).path == link
    monkeypatch.chdir(link.parent)
    assert resolve_planner(name).path.name == name
    check_models({"planner": name})


def test_trial_that_fails_leaves_nothing_and_sees_the_entry_before_it_is_listed(manifest, planner):
    def refuses(entry, folder):
        assert (folder / "tiny.gguf").read_bytes() == planner.read_bytes()
        assert entry.name == "tiny" and not read_local().models
        raise ModelError("it is tired")

    with pytest.raises(ModelError, match="it is tired"):
        add_model(planner, trial=refuses)
    assert not read_local().models


def spm(path, *, prefix):
    """A SentencePiece model, whose texts begin with a space or do not."""
    words = ["<unk>", "<s>", "</s>", *(f"<0x{byte:02X}>" for byte in range(256))]
    said = ["▁", "▁a", "▁the", "▁robot", "the", "robot", "Go", "To", "▁Go", "(", ")", "'", ","]
    letters = [chr(one) for one in range(33, 127) if chr(one) not in said]
    kinds = [2, 3, 3, *[6] * 256, *[1] * (len(said) + len(letters))]

    def fill(writer):
        writer.add_tokenizer_model("llama")
        writer.add_token_list([one.encode() for one in [*words, *said, *letters]])
        writer.add_token_scores(
            [0.0] * len(words) + [-float(n) for n in range(len(said + letters))]
        )
        writer.add_token_types(kinds)
        writer.add_bos_token_id(1)
        writer.add_eos_token_id(2)
        writer.add_add_bos_token(True)
        if not prefix:
            writer.add_add_space_prefix(False)

    size = Size(vocabulary=len(kinds))

    def whole(writer):
        add_keys(writer, language_keys(LLAMA, size))
        fill(writer)

    return write_random_gguf(path, LLAMA, whole, language_tensors(LLAMA, size), seed=3)


@pytest.mark.parametrize("prefix", [True, False])
def test_parts_of_a_text_have_the_tokens_of_the_text(tmp_path, prefix):
    model = LlamaModel(spm(tmp_path / "spm.gguf", prefix=prefix))
    for before, after in (
        ("the robot\n", "GoTo('Apple')\n"),
        ("the robot ", "Go the robot"),
        ("a", "\n\nthe"),
        ("the ", "| robot"),
        ("x\n", "'"),
        ("the\n", " robot"),
        ("the\n", "robot\n\nGo ä"),
    ):
        whole = model.gguf.tokens(before + after, begins=True)
        parts = model.gguf.tokens(before, begins=True) + model.gguf.tokens(after)
        text = b"".join(model.gguf.table.pieces[one] for one in parts).decode()
        assert text == " " * prefix + before + after
        assert np.array_equal(parts, whole) or not before.endswith("\n")  # where no words join
    assert model.gguf.tokens("") == []
    model.close()


def test_gguf_reader_of_the_package_agrees_on_the_keys(planner):
    ours, theirs = check_gguf(planner), format.GGUFReader(planner)
    assert set(ours) == {key for key in theirs.fields if not key.startswith("GGUF.")}
