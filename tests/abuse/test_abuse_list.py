"""Single findings of the list of what gave way once, that no class of attacks draws."""

import json

import pytest
from support import alfred_kitchen
from support.abuse.faults import small_bundle
from support.abuse.files import bundle_for
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.plugins.airgap.install import BundleError, install
from karma.world.core import scene as scenes

TASK = {"id": "a", "kind": "simple", "scene": "kitchen_1",
        "subtasks": [{"instruction": "x", "goals": ["OPEN(Fridge)"]}]}  # fmt: skip


def karma(*words):
    """The exit code and all that was printed; an exception that is no exit fails the test."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def experiment(folder, *, tasks=(TASK,), more=""):
    (folder / "tasks.jsonl").write_text("".join(json.dumps(task) + "\n" for task in tasks))
    path = folder / "x.toml"
    path.write_text(
        f'name = "[/red]"\ntasks = "tasks.jsonl"\n{more}\n[[rows]]\nname = "[/red]"\n'
        'method = "expert"\n'
    )
    return path


@pytest.mark.parametrize(
    ("words", "code", "named"),
    [
        (("run", "x", "--k", "0"), 2, "--k"),
        (("run", "x", "--seed", "-5"), 2, "--seed"),
        (("run", "x", "--vision", "openai"), 1, "vision = 'openai'"),
        (("run", "x", "--threads", "100000"), 1, "threads = 100000"),
        (("run", "x", "--scene", "a\0b"), 1, r"a\x00b"),
        (("run", "x", "--out", "a\0b"), 2, "--out"),
        (("eval", "a\0b"), 2, "null byte"),
        (("eval", "demo", "--seeds", "-5"), 1, "--seeds -5"),
        (("eval", "demo", "--seeds", "0-100000"), 1, "--seeds 0-100000: too many"),
    ],
)
def test_mistake_on_the_command_line_is_told_and_no_traceback(words, code, named):
    assert karma(*words)[0] == code
    assert named in karma(*words)[1]
    assert len(karma(*words)[1]) < 3000


def test_task_file_without_tasks_and_seeds_without_end_are_errors(tmp_path):
    code, said = karma("eval", experiment(tmp_path, tasks=()), "--out", tmp_path / "run")
    assert code == 1
    assert "there is no task in it" in " ".join(said.split())
    path = experiment(tmp_path, more=f"seeds = {list(range(100_000))}")
    code, said = karma("eval", path, "--out", tmp_path / "run")
    assert code == 1
    assert "100000 are too many" in " ".join(said.split())


def test_names_in_markup_are_printed_by_every_command_that_shows_a_run(tmp_path):
    task = {**TASK, "id": "[/red]", "subtasks": [{**TASK["subtasks"][0], "instruction": "[/red]"}]}
    path = experiment(tmp_path, tasks=(task,))
    for words in (("eval", path, "--out", tmp_path / "run", "--tasks"), ("table", tmp_path / "run"),
                  ("tasks", "check", tmp_path / "tasks.jsonl"),
                  ("compare", tmp_path / "run", tmp_path / "run"),
                  ("export", tmp_path / "run", "--to", "csv")):  # fmt: skip
        assert karma(*words)[0] == 0, words
    assert "[/red]" in karma("table", tmp_path / "run")[1]


def test_platform_of_a_bundle_in_markup_is_printed_as_it_is(tmp_path):
    path = tmp_path / "karma.tar"
    path.write_bytes(bundle_for("[/red]"))
    code, said = karma("bundle", "verify", path)
    assert code == 0
    assert "[/red]" in said


def test_trial_whose_id_is_a_path_is_written_nowhere(tmp_path):
    (tmp_path / "in").mkdir()
    trial = {**alfred_kitchen.trial(), "id": "../../x"}
    alfred_kitchen.write(tmp_path / "in" / "trials.jsonl", trial)
    out = tmp_path / "a" / "b" / "out"
    code, said = karma("world", "import-trials", tmp_path / "in" / "trials.jsonl", "--out", out)
    assert code == 1
    assert "cannot be the name of a file" in " ".join(said.split())
    assert [path for path in tmp_path.rglob("*.json") if path.name != "trials.jsonl"] == []


def test_room_of_more_things_than_any_home_has_is_refused(tmp_path):
    raw = json.loads((scenes.SCENES / "kitchen_1.json").read_text())
    one = raw["objects"][0]
    many = [{**one, "id": f"b{n}", "name": f"b{n}", "parents": []} for n in range(5001)]
    (tmp_path / "home.json").write_text(json.dumps({**raw, "objects": many}))
    with pytest.raises(FileError, match="too many"):
        scenes.load(tmp_path / "home.json")


def test_link_planted_where_an_installation_writes_is_not_followed(tmp_path):
    mine, into = tmp_path / "mine.txt", tmp_path / "into"
    mine.write_text("mine")
    into.mkdir()
    (into / ".karma-lock").symlink_to(mine)
    with pytest.raises(BundleError, match="symbolic link"):
        install(small_bundle(), into, smoke=False)
    (into / ".karma-lock").unlink()
    (into / ".karma-part").symlink_to(mine)
    install(small_bundle(), into, smoke=False)
    assert mine.read_text() == "mine"
    for planted, to in (("eval/1.toml", mine), ("eval", tmp_path)):
        (into / planted).rename(into / f".karma-was-{to.name}")
        (into / planted).symlink_to(to)
        with pytest.raises(BundleError, match="outside"):
            install(small_bundle(), into, smoke=False)
        assert mine.read_text() == "mine"
