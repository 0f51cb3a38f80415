"""Experiments by name and by path, and where data lies in a checkout."""

from pathlib import Path

import pytest
from support.paths import ROOT

from karma.errors import FileError
from karma.files import find_experiment, is_checkout, repair, shipped


def test_checkout_uses_its_own_folders():
    assert is_checkout()
    assert shipped("models") == ROOT / "models"
    assert shipped("eval") == ROOT / "eval"
    assert repair("git checkout -- models") == "git checkout -- models"


@pytest.mark.parametrize(
    ("given", "found"),
    [("demo", "demo"), ("demo.toml", "demo"), ("eval/demo.toml", "demo"), ("fig7", "paper/fig7"),
     ("paper/table1", "paper/table1"), ("eval/paper/fig4.toml", "paper/fig4")],
)  # fmt: skip
def test_experiment_is_found_by_name_and_by_path_anywhere(given, found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_experiment(Path(given)) == ROOT / "eval" / f"{found}.toml"


def test_file_of_the_user_goes_before_what_ships(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("demo.toml").write_text("name = 'mine'")
    assert find_experiment(Path("demo.toml")) == Path("demo.toml")


def test_every_experiment_that_ships_is_found_by_its_whole_name():
    for path in (ROOT / "eval").rglob("*.toml"):
        name = path.relative_to(ROOT / "eval").with_suffix("")
        if "results" not in name.parts:
            assert find_experiment(name) == path


@pytest.mark.parametrize(("given", "near"), [("demmo", "demo"), ("eval/tabel1.toml", "table1")])
def test_unknown_experiment_names_the_nearest(given, near):
    with pytest.raises(FileError, match=f"Did you mean '(paper/)?{near}'(.|\n)*To fix: karma eval"):
        find_experiment(Path(given))
