"""Cassettes that mean harm: damaged and hostile."""

from functools import partial

from support.abuse import all_held
from support.abuse.files import Kind, as_json, files

from karma.plugins.hosted.cassette import Cassette

TICK = {"type": "Tick", "scope": "a", "count": 0, "seconds": 1.0}


def test_hostile_cassettes_are_refused_by_name_and_leave_nothing(tmp_path):
    kinds = [
        Kind(
            name="exchanges.jsonl",
            sound=as_json(TICK),
            read=lambda path: Cassette(path.parent, "replay"),
        )
    ]
    all_held(partial(files, kinds=kinds), 28, tmp_path)
