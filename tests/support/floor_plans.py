"""AI2-THOR's recorded floor plans as scenes, for tests of the core; skips without the importer."""

import gzip
import json

import pytest


def floor_plans(shared, *, layouts=False):
    """Yield the scenes of the reference data; `layouts`: with where ALFRED's agents could stand."""
    more = {"layouts": shared / "data/alfred/layouts.json.gz"} if layouts else {}
    yield from _importer().import_dump(_dump(shared), **more)


def recorded_rooms(shared):
    """Yield each recorded room: its row of the dump, and the scene made of it."""
    convert = _importer().scene_from_dump
    with gzip.open(_dump(shared)) as lines:
        for line in lines:
            row = json.loads(line)
            yield row, convert(row["scene"], row["objects"])


def _dump(shared):
    return shared / "data/thor5/scenes.jsonl.gz"


def _importer():
    return pytest.importorskip("karma.plugins.thor_tools.importing.scenes")
