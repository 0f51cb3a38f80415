"""Files that mean harm: refused by name and within bounds, and nothing of the user's is lost."""

import json

import pytest
from support.abuse import all_held
from support.abuse.files import files

from karma.errors import FileError
from karma.files import below, unpack, write_atomic
from karma.journal.folder import is_begun, sweep
from karma.world.core import scene as scenes


def test_hostile_files_of_every_kind_are_refused_by_name_and_leave_nothing(tmp_path):
    all_held(files, 336, tmp_path)


# ----------------------------------------------------------------- the user's own files


def test_folder_that_is_no_run_is_refused_and_keeps_every_file(tmp_path):
    for name in (".env.template", "sub/.bashrc.original", "sub/.x.folder_1/y"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    sweep(tmp_path)
    with pytest.raises(FileError, match="holds no run, but"):
        is_begun(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before


def test_link_stays_and_what_it_leads_to_is_replaced(tmp_path):
    (tmp_path / "to").mkdir()
    target, link = tmp_path / "to" / "figures.json", tmp_path / "link.json"
    target.write_text("old")
    link.symlink_to(target)
    write_atomic(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert sorted(path.name for path in (tmp_path / "to").iterdir()) == ["figures.json"]


# ----------------------------------------------------------------- names that become paths


@pytest.mark.parametrize(
    "name",
    ["../x", "/tmp/x", "a/b", "..", "", ".hidden", "a\0b", "a\nb", "\x1b[2J", "x" * 300, "a\\b"],
)
def test_name_of_somebody_s_file_never_leads_out_of_the_folder(name, tmp_path):
    with pytest.raises(FileError, match="cannot be the name of a file"):
        below(tmp_path, name)


# ----------------------------------------------------------------- numbers and sizes


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"grid_m": 0}, "grid_m"),
        ({"grid_m": -0.25}, "grid_m"),
        ({"agent": {"position": [1e308, 0, 0]}}, "agent"),
        ({"bounds_size": [1e9, 3, 1e9]}, "bounds_size"),
        ({"bounds_size": [4, -1, 4]}, "bounds_size"),
        ({"floor_y": 1e300}, "floor_y"),
        ({"reachable": [[1e308, 0]]}, "reachable"),
    ],
)
def test_scene_with_senseless_numbers_is_refused_before_anything_is_computed(
    changes, named, tmp_path
):
    path = tmp_path / "home.json"
    raw = json.loads((scenes.SCENES / "kitchen_1.json").read_text())
    path.write_text(json.dumps({**raw, **changes}))
    with pytest.raises(FileError, match=named):
        scenes.load(path)


def test_gzip_bomb_is_unpacked_to_its_limit_only(tmp_path):
    import gzip

    with pytest.raises(FileError, match="unpacks to more than 1 MiB"):
        unpack(gzip.compress(bytes(50 << 20)), path="x.gz", most=1 << 20)
