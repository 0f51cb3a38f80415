"""Dumps that mean harm: damaged, hostile, or with rooms whose names are paths."""

import gzip
import json
from functools import cache, partial

from support.abuse import all_held
from support.abuse.files import Kind, as_json, files
from support.abuse.names import names
from support.household import kitchen
from typer.testing import CliRunner

from karma.cli import app
from karma.plugins.thor_tools.importing.dump import read_layouts
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.world.sim import EmbeddedWorld


@cache
def dumped():
    objects = EmbeddedWorld(kitchen()).last_event.metadata["objects"]
    row = {"scene": "FloorPlan1", "objects": [dict(thing) for thing in objects][:6]}
    return json.dumps(row, default=list).encode() + b"\n"


def dumped_as(scene):
    """Return a dump of a room whose name is this piece of JSON."""
    return dumped().replace(b'"FloorPlan1"', scene.encode(), 1)


def imported(path):
    return list(import_dump(path))


def test_hostile_dumps_are_refused_by_name_and_leave_nothing(tmp_path):
    layouts = as_json({"a": {"reachable": [[0, 0]]}})
    kinds = [
        Kind(name="dump.jsonl", sound=dumped, read=imported),
        Kind(
            name="dump.jsonl.gz", sound=lambda: gzip.compress(dumped()), read=imported, text=False
        ),
        Kind(name="layouts.json", sound=layouts, read=read_layouts),
    ]
    all_held(partial(files, kinds=kinds), 84, tmp_path)


def _of_a_room(name, folder):
    dump = folder / "dump.jsonl"
    dump.write_bytes(dumped_as(json.dumps(name)))
    said = CliRunner().invoke(app, ["world", "import", str(dump), "--out", str(folder / "out")])
    assert said.exit_code in (0, 1), said.output
    assert said.exception is None or isinstance(said.exception, SystemExit), repr(said.exception)


def test_name_of_a_room_never_leaves_the_folder(tmp_path):
    all_held(partial(names, ways=(_of_a_room,)), 50, tmp_path)
