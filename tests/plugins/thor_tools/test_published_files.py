"""Files as they are published: ALFRED's tree of folders, values one after another, raw metadata."""

import json

import pytest
from support import alfred_kitchen as ours
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.plugins.alfred.replay.trial import read_trials
from karma.plugins.alfred.suites.benchmark import room_files
from karma.plugins.thor_tools.importing.dump import rows
from karma.world.sim import EmbeddedWorld


def trials(count=3):
    return [{**ours.trial(), "task_id": f"trial_{number}"} for number in range(count)]


FORMS = {
    "folders": lambda place: [
        put(place / "json_2.1.0" / f"task{n}" / one["task_id"] / "traj_data.json", one, indent=4)
        for n, one in enumerate(trials())
    ],
    "pp": lambda place: [
        put(place / f"task{n}" / one["task_id"] / "pp" / "ann_0.json", one, indent=1)
        for n, one in enumerate(trials())
    ],
    "values": lambda place: write(place / "all.json", "".join(pretty(one) for one in trials())),
    "values apart": lambda place: write(
        place / "all.json", "\n\n".join(pretty(one) for one in trials()) + "\n"
    ),
    "an array": lambda place: write(place / "all.json", json.dumps(trials(), indent=1)),
    "lines": lambda place: write(place / "all.json", "\n".join(map(json.dumps, trials()))),
}


def pretty(one):
    return json.dumps(one, indent=4)


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def put(path, one, **how):
    return write(path, json.dumps(one, **how))


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_trials_are_read_as_they_are_published(form, tmp_path):
    found = form(tmp_path)
    path = tmp_path if isinstance(found, list) else found
    assert [one.task_id for one in read_trials(path)] == ["trial_0", "trial_1", "trial_2"]
    assert set(found if isinstance(found, list) else [found]) <= set(room_files(path))


@pytest.mark.parametrize("cut", [3, 400, 2000])
def test_torn_value_after_whole_ones_is_told_with_its_line(tmp_path, cut):
    text = "\n".join(pretty(one) for one in trials())
    path = write(tmp_path / "all.json", text[:-cut])
    with pytest.raises(FileError, match=r"line \d+: "):
        list(read_trials(path))


def test_folder_without_trials_says_what_was_looked_for(tmp_path):
    put(tmp_path / "a" / "other.json", {})
    with pytest.raises(FileError, match=r"no traj_data\.json in it"):
        list(read_trials(tmp_path))


@pytest.mark.parametrize("cells", [True, False])
@pytest.mark.parametrize("wrapped", [True, False])
def test_raw_metadata_of_an_event_is_imported(tmp_path, cells, wrapped):
    world = EmbeddedWorld("kitchen_2")
    event = world.reset("kitchen_2")
    if cells:
        event = world.step("GetReachablePositions")
    told = json.loads(json.dumps(dict(event.metadata), default=list))
    told["sceneName"] += "_physics"
    path = put(tmp_path / "dump.json", {"metadata": told} if wrapped else told)
    shown = CliRunner().invoke(app, ["world", "import", str(path), "--out", str(tmp_path / "out")])
    assert shown.exit_code == 0, shown.output
    scene = json.loads((tmp_path / "out" / "kitchen_2.json").read_text())
    assert len(scene["objects"]) == len(told["objects"])
    if cells:
        wanted = {(one["x"], one["z"]) for one in told["actionReturn"]}
        assert {tuple(one) for one in scene["reachable"]} == wanted


def test_objects_alone_say_what_is_missing(tmp_path):
    path = put(tmp_path / "objects.json", [{"objectId": "Mug|1|2|3", "objectType": "Mug"}])
    with pytest.raises(FileError, match="the scene's name and its cells are missing"):
        list(rows(path))
