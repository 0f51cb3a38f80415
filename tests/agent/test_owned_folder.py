"""Every command that writes a folder: it owns what it wrote, by its mark, and touches no more."""

import json
import shutil

import pytest
from support.run_files import write_experiment
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.journal.owned_folder import (
    MADE,
    MARK,
    OwnedFolder,
    kind_in,
    read_mark,
    write_beside,
)

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


# ----------------------------------------------------------------- what kind it is


@pytest.mark.parametrize("kind", KINDS[:-1])
def test_kind_of_a_folder_is_known_with_and_without_its_mark(finished, tmp_path, kind):
    folder = tmp_path / "run"
    shutil.copytree(finished(kind), folder)
    assert kind_in(folder) == kind
    (folder / MARK).unlink()
    assert kind_in(folder) == ("run" if kind == "talk" else kind)
    assert kind_in(tmp_path) is None


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


@pytest.mark.parametrize("kind", ["run", "benchmark", "figure", "talk"])
def test_finished_folder_is_no_other_command_s(commands, finished, tmp_path, kind):
    shutil.copytree(finished(kind), tmp_path / "there")
    before = contents(tmp_path / "there")
    for other in KINDS:
        if other == kind:
            continue
        done = told(commands[other], tmp_path / "there")
        assert done.exit_code == 1, (other, done.output)
        assert contents(tmp_path / "there") == before, other
        assert "--out another folder" in done.output


@pytest.mark.parametrize("kind", ["run", "benchmark", "figure"])
def test_fresh_start_keeps_what_somebody_has_put_beside_and_ends_in_the_same_files(
    commands, finished, tmp_path, kind
):
    folder = tmp_path / "again"
    shutil.copytree(finished(kind), folder)
    theirs = ("notes.txt", "cells/notes.txt", "maps/mine.json", "steps/notes.txt")
    for name in theirs:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("mine")
    done = told(commands[kind], folder, "--fresh")
    assert done.exit_code == 0, done.output
    assert all((folder / name).read_text() == "mine" for name in theirs)
    names = {name for name, data in contents(folder).items() if data is not None}
    whole = {name for name, data in contents(finished(kind)).items() if data is not None}
    assert names == whole | set(theirs)


# ----------------------------------------------------------------- the mark


def test_mark_names_each_file_of_a_finished_run(finished):
    folder = finished("run")
    begun, names = read_mark(folder)
    there = {name for name, data in contents(folder).items() if data is not None}
    assert begun.kind == "run"
    assert there - {MARK} <= names
    assert MADE not in there


def test_mark_with_a_torn_end_is_gone_on_with(tmp_path):
    owned = OwnedFolder(tmp_path, "run")
    owned.begin(["a"])
    owned.own("b")
    mark = tmp_path / MARK
    mark.write_bytes(mark.read_bytes() + b'\n"steps/torn')
    again = OwnedFolder(tmp_path, "run")
    assert again.look()
    again.write("c", b"c")
    assert read_mark(tmp_path)[1] == {"a", "b", "c"}


@pytest.mark.parametrize("name", ["../mine", "/mine", "a/../../mine", "..", ""])
def test_mark_that_names_a_file_elsewhere_removes_nothing_there(tmp_path, name):
    folder, mine = tmp_path / "run", tmp_path / "mine"
    mine.write_text("mine")
    OwnedFolder(folder, "run").begin(["a"])
    with (folder / MARK).open("ab") as mark:
        mark.write(json.dumps(name.replace("/mine", str(mine))).encode() + b"\n")
    owned = OwnedFolder(folder, "run")
    assert owned.look()
    owned.clear()
    assert mine.read_text() == "mine"


def test_file_that_came_into_the_way_of_a_run_is_not_replaced(tmp_path):
    owned = OwnedFolder(tmp_path, "run")
    owned.begin(["episodes.jsonl"])
    (tmp_path / "steps").mkdir()
    (tmp_path / "steps" / "a").write_text("mine")
    with pytest.raises(FileError, match="is there, and this run did not write it"):
        owned.write("steps/a", b"ours")
    assert (tmp_path / "steps" / "a").read_text() == "mine"


# ----------------------------------------------------------------- what is made of runs


def test_page_and_tables_of_a_run_replace_their_own_and_nothing_else(finished, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(finished("run"), folder)
    made = {"report": "report.html", "table": "table.csv"}
    for command, name in made.items():
        for _ in range(2):
            done = CliRunner().invoke(app, [command, str(folder)])
            assert done.exit_code == 0, done.output
        (folder / name).write_text("mine")
        done = CliRunner().invoke(app, [command, str(folder)])
        assert (done.exit_code, (folder / name).read_text()) == (1, "mine"), done.output
        assert "To fix: move it away, or --out another place" in done.output


def test_page_of_a_folder_without_a_mark_is_written_once_and_again(tmp_path):
    write_beside(tmp_path, "comparison.html", b"one")
    write_beside(tmp_path, "comparison.html", b"two")
    assert (tmp_path / "comparison.html").read_bytes() == b"two"
    (tmp_path / "table.md").write_text("mine")
    with pytest.raises(FileError, match="no such command has written it"):
        write_beside(tmp_path, "table.md", b"ours")
