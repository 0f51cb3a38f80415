"""What a run was told, and that a comparison names every difference."""

import json

import msgspec
import pytest
from support.run_files import TASKS, copy, karma
from support.tiny import export_tiny

from karma import registry
from karma.bench.engine.experiment import Experiment
from karma.bench.engine.experiment_file import Changes, setting_of
from karma.bench.engine.our_tasks import configuration
from karma.bench.engine.run import Run
from karma.errors import KarmaError
from karma.journal.folder import HEADER
from karma.journal.header import options_apart, rows_apart
from karma.loading.models import Models, Row

ROW = '[[rows]]\nname = "expert"\nmethod = "expert"\n[[rows]]\nname = "idle"\nmethod = "idle"\n'


def told(**models):
    rows = (Row(name="a"), Row(name="b", preset="paper", options={"seen_kept": 1}))
    experiment = Experiment(name="x", rows=rows, tasks="t.jsonl", models=Models(**models))
    return configuration(experiment)


def test_configuration_has_every_key_of_the_experiment_with_its_default():
    found = told()
    for kind, there in ((Experiment, found), (Models, found["models"]), (Row, found["rows"][0])):
        assert {field.name for field in msgspec.structs.fields(kind)} <= there.keys()
    models = found["models"]
    assert (models["profile"], models["constraint"]) == ("compact", "types")
    assert models["refusing"] in (True, False)


def test_configuration_of_a_row_has_what_its_method_and_preset_fill_in():
    plain, paper = told()["rows"]
    assert (plain["recall"], paper["recall"]) == ("stateful", "cosine:listing")
    assert (plain["options"]["recall_k"], paper["options"]["recall_k"]) == (3, 10)
    assert (plain["options"]["seen_kept"], paper["options"]["seen_kept"]) == (2, 1)
    assert plain["vision"] == "metadata"


@pytest.mark.parametrize("name", registry.names("methods"))
def test_every_method_of_ours_tells_its_options_by_what_it_refuses_others(name):
    kind = registry.load("methods", name)
    known = msgspec.to_builtins(kind.settings_kind()).keys()
    with pytest.raises(KarmaError, match="unknown option 'zzz'") as caught:
        kind.build(None, {"zzz": 1})
    assert all(option in str(caught.value) for option in known)


def test_differences_name_each_option_and_nothing_that_is_equal():
    assert options_apart(told(), told()) == []
    assert options_apart(told(), told(constraint="free", examples=5)) == [
        'models.constraint: "types" became "free"',
        "models.examples: null became 5",
    ]
    words = rows_apart(told(), "a", told(), "b")
    assert 'row a -> b: preset: "" became "paper"' in words
    assert "row a -> b: options.recall_k: 3 became 10" in words
    assert not any("policy" in word for word in words)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs that differ in one switch."""
    folder = tmp_path_factory.mktemp("runs")
    planner = export_tiny(folder / "tiny.gguf")
    path = folder / "x.toml"
    path.write_text(
        f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-12"]\n{ROW}'
        f'[models]\nplanner = "{planner}"\nprofile = "compact"\n'
    )
    for name, more in (("a", ()), ("b", ("models.constraint=free",))):
        changes = Changes(settings=tuple(map(setting_of, more)))
        list(Run(path, folder / name, changes=changes).episodes())
    return folder


def compared(*runs):
    result = karma("compare", *map(str, runs))
    return result.replace("\n", " ")


def test_compare_names_every_difference(runs):
    a, b = runs / "a", runs / "b"
    assert f'{b}: models.constraint: "types" became "free"' in compared(a, b)
    assert f"{b}:idle: row expert -> idle: method:" in compared(f"{a}:expert", f"{b}:idle")
    assert "models.constraint" not in compared(a, copy(a, runs / "c"))


def test_configuration_is_what_the_folder_keeps(runs):
    kept = json.loads((runs / "b" / HEADER).read_text())["options"]
    assert kept["models"]["constraint"] == "free"
    assert [row["name"] for row in kept["rows"]] == ["expert", "idle"]
