"""An experiment said otherwise by a command, and where the paths in it begin."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.paths import ROOT
from support.run_files import TASKS
from typer.testing import CliRunner

from karma.bench.engine.experiment import load
from karma.bench.engine.experiment_file import (
    Changes,
    Setting,
    beside,
    read_experiment,
    seeds_of,
    setting_of,
)
from karma.bench.engine.our_tasks import configuration
from karma.cli import app
from karma.errors import FileError, KarmaError
from karma.journal.header import options_apart, without_places

TEXT = f"""
name = "x"
tasks = "{TASKS}"
[[rows]]
name = "KARMA (K = 1.5)"
options = {{ recall_k = 1 }}
[[rows]]
name = "expert"
method = "expert"
"""


@pytest.fixture
def path(tmp_path):
    place = tmp_path / "x.toml"
    place.write_text(TEXT)
    return place


def said(path, *texts, rows=()):
    return read_experiment(path, Changes(settings=tuple(map(setting_of, texts)), rows=rows))


# ----------------------------------------------------------------- settings


def test_setting_of_every_depth_is_what_the_experiment_says_then(path):
    found = said(
        path,
        "models.examples=5",
        "seeds=[3, 4]",
        "rows.KARMA (K = 1.5).options.recall_k=7",
        'rows."expert".method=idle',
        "rows.*.vision=blind",
        "models.constraint=free",
        "models.gpu_layers=4",
    )
    assert (found.models.examples, found.seeds) == (5, (3, 4))
    assert (found.models.constraint, found.models.gpu_layers) == ("free", 4)
    assert [row.options for row in found.rows] == [{"recall_k": 7}, {}]
    assert [row.method for row in found.rows] == ["karma", "idle"]
    assert {row.vision for row in found.rows} == {"blind"}


def test_key_ends_where_a_name_does():
    row = Setting(key='rows."a.b=c".vision', value="x=1")
    assert setting_of('rows."a.b=c".vision=x=1') == row
    assert setting_of("rows.K = 1.options.x=2").key == "rows.K = 1.options.x"
    assert setting_of("models.planner=a.b=c").value == "a.b=c"


def test_word_that_looks_like_a_number_stays_a_word_where_words_are_meant(path):
    found = said(path, "name=5")
    assert found.name == "5"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("models.plannr=x", r"models\.plannr: no key 'plannr'\n  To fix: write 'planner'"),
        ("modles.planner=x", "write 'models'"),
        ("rows.expret.method=idle", r"no such row\. Did you mean 'expert'"),
        ("rows.expert.methud=idle", "write 'method'"),
        ("models.threads=many", r"models\.threads = 'many': Expected `int`, got `str`"),
        ("models.constraint=1", r"models\.constraint = 1: Expected `str`"),
        ("models.planner", "it is KEY=VALUE"),
        ("=x", "it is KEY=VALUE"),
        ("models.examples=9", "examples = 9: 0 to 8"),
        ("limit=0", "limit = 0: 1 or more"),
        ("rows=[]", "rows: there is none"),
        ("rows.expert=1", "no such row"),
        ("rows.expert.=1", "no key ''"),
        ("models=1", "Expected `object`, got `int`"),
        ("models.planner.x=1", "models.planner.x"),
        ("name.x.y=1", "name.x.y"),
        ("seeds=5", "Expected `array`"),
        ("world=thorr", "Did you mean 'thor'"),
    ],
)
def test_wrong_setting_is_refused_with_what_was_meant(path, text, words):
    with pytest.raises(KarmaError, match=words):
        said(path, text)


def test_rows_are_chosen_by_name_or_pattern_in_the_file_s_order(path):
    assert [row.name for row in said(path, rows=("expert",)).rows] == ["expert"]
    both = said(path, rows=("expert", "KARMA*")).rows
    assert [row.name for row in both] == ["KARMA (K = 1.5)", "expert"]
    with pytest.raises(KarmaError, match=r"no row 'exprt'\. Did you mean 'expert'"):
        said(path, rows=("exprt",))


def test_tasks_are_chosen_by_pattern_and_number(path):
    chosen = said(path, 'only=["simple-1?", "complex-02"]')
    ids = [task.id for task in load(chosen, path).tasks]
    assert ids == [*(f"simple-{number}" for number in range(10, 16)), "complex-02"]
    first = said(path, 'only=["simple-1?"]', "limit=2")
    assert [task.id for task in load(first, path).tasks] == ids[:2]
    with pytest.raises(FileError, match="no task 'simpel-'"):
        load(said(path, 'only=["simpel-"]'), path)


@given(first=st.integers(0, 500), more=st.integers(0, 50))
def test_span_of_seeds_has_both_ends(first, more):
    assert seeds_of(f"{first}-{first + more}") == list(range(first, first + more + 1))


def test_command_that_sets_nothing_new_has_the_identity_of_the_file(path):
    """A setting decides by its content only, not by where it stands."""

    plain = configuration(read_experiment(path))
    assert options_apart(plain, configuration(said(path, "models.threads=1"))) == []
    changed = configuration(said(path, "models.examples=1"))
    assert options_apart(plain, changed) == ["models.examples: null became 1"]
    written = path.with_name("y.toml")
    written.write_text(TEXT + "[models]\nexamples = 1\n")
    assert options_apart(configuration(read_experiment(written)), changed) == []


def test_run_folder_of_other_settings_is_refused_by_name(path, tmp_path):
    def karma_eval(*more):
        options = ["--row", "expert", "--limit", "1", "--no-steps", "--workers", "1"]
        command = ["eval", str(path), "--out", str(tmp_path / "run"), *options, *more]
        return CliRunner().invoke(app, command)

    assert karma_eval().exit_code == 0
    refused = karma_eval("--set", "models.constraint=free", "--seeds", "0-1")
    assert refused.exit_code == 1
    assert 'models.constraint: "types" became "free"' in refused.output
    assert "seeds: [0] became [0,1]" in refused.output


# ----------------------------------------------------------------- paths


def test_path_in_a_file_is_relative_to_that_file(tmp_path, monkeypatch):
    below = tmp_path / "folder"
    below.mkdir()
    (below / "t.jsonl").write_bytes(TASKS.read_bytes())
    (below / "x.toml").write_text(TEXT.replace(str(TASKS), "t.jsonl"))
    monkeypatch.chdir(tmp_path)
    path = Path("folder/x.toml")
    found = read_experiment(path)
    assert found.tasks == str(below / "t.jsonl")
    assert len(load(found, path).tasks) > 40


def test_path_that_a_command_gives_is_relative_to_where_it_is_given(path, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    found = said(path, "models.planner=own.gguf", "models.embedder=sentence:./e")
    assert found.models.planner == str(tmp_path / "here" / "own.gguf")
    assert found.models.embedder == f"sentence:{tmp_path}/here/e"


def test_path_relative_to_the_working_directory_is_refused_with_the_right_one(
    tmp_path, monkeypatch
):
    (tmp_path / "sub").mkdir()
    (tmp_path / "t.jsonl").write_bytes(TASKS.read_bytes())
    path = tmp_path / "sub" / "x.toml"
    path.write_text(TEXT.replace(str(TASKS), "t.jsonl"))
    monkeypatch.chdir(tmp_path)
    path = Path("sub/x.toml")
    with pytest.raises(FileError, match=r"relative to this file\n  To fix: write '\.\./t\.jsonl'"):
        load(read_experiment(path), path)
    (tmp_path / "t.jsonl").unlink()
    with pytest.raises(FileError, match=r"sub/t\.jsonl: No such file"):
        load(read_experiment(path), path)


def test_shared_folder_may_lie_elsewhere(monkeypatch, tmp_path):
    monkeypatch.setenv("KARMA_SHARED", str(tmp_path))
    assert beside(Path("eval"), "../../shared/a/b") == tmp_path / "a/b"
    assert beside(Path("/eval"), "shared/a") == Path("/eval/shared/a")
    monkeypatch.delenv("KARMA_SHARED")
    assert beside(Path("/x/eval"), "../../shared/a") == Path("/shared/a")


@pytest.mark.parametrize(
    "path",
    [*sorted((ROOT / "eval").glob("*.toml")), *sorted((ROOT / "eval/paper").glob("table*.toml"))],
    ids=lambda path: path.stem,
)
def test_shipped_experiments_name_files_that_are_there_or_made_or_lent(path):
    text = path.read_text()
    for name in re.findall(r'"([^"\n]*/[^"\n]*\.(?:jsonl|json|gz|csv))"', text):
        there = (path.parent / name).resolve()
        assert there.exists() or "shared/" in name or there.is_relative_to(ROOT / "runs"), name


def test_where_files_lie_decides_nothing():
    plain = {"tasks": "/a/t.jsonl", "models": {"planner": "/a/p.gguf", "profile": "full"}}
    assert without_places(plain) == {
        "tasks": "t.jsonl",
        "models": {"planner": "p.gguf", "profile": "full"},
    }
