"""Damaged and hostile dumps."""

import gzip
import json
from functools import cache, partial

from support.abuse import all_held
from support.abuse.files import Kind, as_json, files
from support.household import kitchen

from karma.plugins.thor_tools.importing.dump import read_layouts
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.world.sim import EmbeddedWorld


@cache
def dumped():
    objects = EmbeddedWorld(kitchen()).last_event.metadata["objects"]
    row = {"scene": "FloorPlan1", "objects": [dict(thing) for thing in objects][:6]}
    return json.dumps(row, default=list).encode() + b"\n"


def imported(path):
    return list(import_dump(path))


def test_hostile_dumps_are_refused_by_name_and_leave_nothing(tmp_path):
    layouts = as_json({"a": {"reachable": [[0, 0]]}})
    kinds = [
        Kind(name="dump.jsonl", sound=dumped, read=imported),
        Kind(name="dump.jsonl.gz", sound=lambda: gzip.compress(dumped()), read=imported),
        Kind(name="layouts.json", sound=layouts, read=read_layouts),
    ]
    all_held(partial(files, kinds=kinds), 84, tmp_path)
