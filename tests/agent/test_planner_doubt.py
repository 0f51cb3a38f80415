"""Which planners may refuse, and whose doubt is read."""

import hashlib

import pytest

from karma.agent.loading.planner_files import doubt_of, may_refuse
from karma.agent.planning.refused_requests import LogisticDoubt
from karma.errors import ModelError
from karma.files import to_json
from karma.infer.manifest.manifest import ModelEntry, ModelFile

FITTED = LogisticDoubt(
    coefficients={"refusing": 1.0}, intercept=0.0, threshold=0.5, fitted_on="nothing"
)
ENTRY = """
[[models]]
name = "{name}"
role = "planner"
format = "gguf"
licence = "MIT"
source = "here"
prompt_profile = "compact"
context_length = 64
refuses = {refuses}
doubt = "{doubt}"
files = [
  {{ path = "planner.gguf", sha256 = "{planner}" }},
  {{ path = "doubt.json", sha256 = "{sha}" }},
]
"""


@pytest.fixture
def models(tmp_path, monkeypatch):
    (tmp_path / "doubt.json").write_bytes(to_json(FITTED))
    (tmp_path / "planner.gguf").write_bytes(b"abc")
    hashes = {
        "planner": hashlib.sha256(b"abc").hexdigest(),
        "sha": hashlib.sha256(to_json(FITTED)).hexdigest(),
    }
    (tmp_path / "manifest.toml").write_text(
        ENTRY.format(name="learnt", refuses="true", doubt="doubt.json", **hashes)
        + ENTRY.format(name="plain", refuses="false", doubt="", **hashes)
    )
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path))
    return tmp_path


def test_planner_of_the_manifest_may_refuse_if_it_has_learnt_to_or_is_told_so(models):
    assert (may_refuse("learnt"), may_refuse("plain")) == (True, False)
    assert (may_refuse("learnt", said=False), may_refuse("plain", said=True)) == (False, True)
    assert (doubt_of("learnt"), doubt_of("plain")) == (FITTED, None)


def test_planner_by_its_path_has_the_doubt_beside_it_and_may_refuse_then(models, tmp_path):
    path = models / "planner.gguf"
    assert may_refuse(str(path))
    assert doubt_of(str(path)) == FITTED
    (models / "doubt.json").unlink()
    assert not may_refuse(str(path))
    assert doubt_of(str(path)) is None


def test_doubt_that_was_changed_is_refused(models):
    (models / "doubt.json").write_bytes(b"{}")
    with pytest.raises(ModelError, match=r"doubt\.json"):
        doubt_of("learnt")


def test_doubt_that_is_no_file_of_its_model_is_refused():
    with pytest.raises(ValueError, match="is none of its files"):
        ModelEntry(
            name="x", role="planner", format="gguf", files=(ModelFile(path="x.gguf"),),
            licence="MIT", source="here", prompt_profile="compact", context_length=1,
            doubt="doubt.json",
        )  # fmt: skip
