"""Every command that writes a folder: it owns what it wrote, by its mark, and touches no more."""

import shutil

import pytest
from support.run_files import write_experiment
from typer.testing import CliRunner

from karma.cli import app
from karma.journal.folder import MARK

RUN = 'name = "expert"\nmethod = "expert"\n'
FIGURE = (
    'kind = "trace"\nname = "x"\npolicies = ["fifo-merge[3]"]\nworkloads = ["type"]\n'
    'unit_sets = ["m"]\nsequences = 2\nlength = 10\ncheckpoints = [5, 10]\n'
)
BENCHMARK = """
name = "small"
benchmark = "lived"
homes = 1
days = 1
first_home = 70
settings = [{ name = "usual", rooms = [2] }]
rows = [{ name = "expert", design = "expert" }]
"""
KINDS = ("run", "benchmark", "figure", "talk", "chat")


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    """Kind of folder -> the words of the command that writes it."""
    place = tmp_path_factory.mktemp("experiments")
    rows, more = f"[[rows]]\n{RUN}", "seeds = [0]"
    write_experiment(place / "run.toml", "karma-nano", rows=rows, only=["simple-11"], more=more)
    (place / "figure.toml").write_text(FIGURE)
    (place / "benchmark.toml").write_text(BENCHMARK)
    evals = ("run", "benchmark", "figure")
    found = {kind: ["eval", str(place / f"{kind}.toml")] for kind in evals}
    return {**found, "talk": ["run", "open the fridge"], "chat": ["chat", "--fresh"]}


def told(words, out, *more):
    return CliRunner().invoke(app, [*words, "--out", str(out), *more], input="/quit\n")


def contents(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() if p.is_file() else None
            for p in folder.rglob("*")}  # fmt: skip


@pytest.fixture(scope="module")
def finished(commands, tmp_path_factory):
    """A function that returns a finished folder of a kind, made once."""
    base, made = tmp_path_factory.mktemp("finished"), {}

    def folder(kind):
        if kind not in made:
            made[kind] = base / kind
            assert told(commands[kind], made[kind]).exit_code in (0, 2)
        return made[kind]

    return folder


@pytest.mark.parametrize(
    ("kind", "command", "given"),
    [
        ("figure", "eval", "--only=x"),
        ("figure", "eval", "--gpu-layers=0"),
        ("benchmark", "eval", "--no-steps"),
        ("benchmark", "eval", "--fail-under=1"),
        ("figure", "report", "--episodes=2"),
        ("benchmark", "report", "--episodes=1"),
    ],
)
def test_option_that_is_of_no_use_is_refused_by_name(commands, finished, kind, command, given):
    words = commands[kind] if command == "eval" else [command, str(finished(kind))]
    before = contents(finished(kind))
    done = CliRunner().invoke(app, [*words, given])
    option = given.partition("=")[0].replace("--no-", "--")
    assert (done.exit_code, f"has no {option}\n" in done.output) == (1, True), done.output
    assert contents(finished(kind)) == before


# ----------------------------------------------------------------- somebody's files

THEIRS = {
    "only a config.json": {"config.json": "mine"},
    "a header.json with an experiment": {"header.json": '{"experiment": "mine"}'},
    "a header.json of a benchmark": {"header.json": '{"benchmark": "lived"}'},
    "records and folders": {
        "episodes.jsonl": "", "maps/a.json": "mine", "scenes/a.json": "mine", "steps/a": "mine",
    },
    "results": {"results.json": "{}", "timings.jsonl": ""},
    "a sweep.json": {"sweep.json": "mine", "table.md": "mine", "cells/a/x": "mine"},
    "a figure's cells": {"cells/type-m.json": "mine", "claims.md": "mine"},
    "a mark that is none": {MARK: "mine", "episodes.jsonl": "mine"},
    "another's mark": {MARK: '{"made by": "another tool"}', "maps/a.json": "mine"},
}  # fmt: skip


@pytest.mark.parametrize("fresh", [False, True], ids=["", "fresh"])
@pytest.mark.parametrize("kind", KINDS)
def test_folder_with_somebody_s_files_is_refused_and_stays_as_it_is(
    commands, tmp_path, kind, fresh
):
    for number, theirs in enumerate(THEIRS.values()):
        folder = tmp_path / str(number)
        for name, text in theirs.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        before = contents(folder)
        if fresh and kind in ("talk", "chat"):
            continue  # they have no such option
        done = told(commands[kind], folder, *["--fresh"] * fresh)
        assert (done.exit_code, contents(folder)) == (1, before), (theirs, done.output)
        assert "--out another folder" in done.output


@pytest.mark.parametrize(
    ("kind", "other"),
    [("run", "benchmark"), ("benchmark", "figure"), ("talk", "run"), ("run", "talk")],
)
def test_finished_folder_is_no_other_command_s(commands, finished, tmp_path, kind, other):
    shutil.copytree(finished(kind), tmp_path / "there")
    before = contents(tmp_path / "there")
    done = told(commands[other], tmp_path / "there")
    assert done.exit_code == 1, done.output
    assert contents(tmp_path / "there") == before
    assert "--out another folder" in done.output


@pytest.mark.parametrize("kind", ["run", "benchmark", "figure"])
def test_fresh_start_sets_the_earlier_folder_aside_with_all_that_is_in_it(
    commands, finished, tmp_path, kind
):
    real, folder = tmp_path / "real", tmp_path / "a link"
    shutil.copytree(finished(kind), real)
    folder.symlink_to(real)
    for name in ("notes.txt", "maps/mine.json", "figure-mine.png", "results.json.mine"):
        (real / name).parent.mkdir(exist_ok=True)
        (real / name).write_text("mine")
    before = contents(real)
    done = told(commands[kind], folder, "--fresh")
    assert done.exit_code == 0, done.output
    assert f"the earlier run is kept: {tmp_path / 'real.1'}" in done.output
    assert contents(tmp_path / "real.1") == before
    assert folder.is_symlink() and contents(real).keys() == contents(finished(kind)).keys()
    assert told(commands[kind], folder, "--fresh").exit_code == 0
    assert contents(tmp_path / "real.1") == before and (tmp_path / "real.2").exists()


@pytest.mark.parametrize("kind", KINDS)
def test_command_goes_by_no_link_out_of_its_folder(commands, tmp_path, kind):
    """The folder is taken, then a link to somebody's folder or file comes into the way."""
    folder, theirs = tmp_path / "run", tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "a.txt").write_text("mine")
    folder.mkdir()
    for name in ("header.json", "episodes.jsonl", "steps"):
        (folder / name).symlink_to(theirs / "a.txt" if "." in name else theirs)
    for fresh in ([], ["--fresh"]) if kind in ("run", "benchmark", "figure") else ([],):
        assert told(commands[kind], folder, *fresh).exit_code == 1
    (folder / MARK).write_text("{}")
    assert told(commands[kind], folder).exit_code == 1
    assert contents(theirs) == {"a.txt": b"mine"}
    assert all(one.is_symlink() or one.name == MARK for one in folder.iterdir())


@pytest.mark.parametrize(
    ("kind", "command", "names"),
    [
        ("run", "report", ["report.html"]),
        ("run", "table", ["table.md", "table.csv"]),
        ("benchmark", "report", ["report.html"]),
        ("benchmark", "table", ["table.md"]),
        ("figure", "report", ["report.html"]),
        ("talk", "report", ["report.html"]),
    ],
)
def test_page_and_table_replace_only_what_their_command_has_made(
    finished, tmp_path, kind, command, names
):
    run, theirs = tmp_path / "run", tmp_path / "theirs"
    shutil.copytree(finished(kind), run)
    theirs.write_text("mine")

    def again():
        return CliRunner().invoke(app, [command, str(run)])

    assert [again().exit_code, again().exit_code] == [0, 0]  # its own is replaced
    for name in names:
        made = (run / name).read_bytes()
        (run / name).write_text("mine")
        done = again()
        assert (done.exit_code, (run / name).read_text()) == (1, "mine"), done.output
        assert f"{name}: there already, and not made by this command" in done.output
        (run / name).unlink()
        (run / name).symlink_to(theirs)
        assert again().exit_code == 1
        assert theirs.read_text() == "mine"
        (run / name).unlink()
        (run / name).write_bytes(made)
    (run / MARK).write_text('{"made by": "another tool"}')
    before = contents(run)
    assert (again().exit_code, contents(run)) == (1, before)


def test_results_that_the_run_did_not_write_are_refused(commands, finished, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished("run"), run)
    (run / "results.json").write_text("mine")
    before = contents(run)
    done = told(commands["run"], run)
    assert (done.exit_code, contents(run)) == (1, before), done.output
