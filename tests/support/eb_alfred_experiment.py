"""An experiment of EB-ALFRED over our kitchen, as a fixture."""

import json

import pytest

from support import alfred_kitchen as ours
from support import eb_alfred as eb


@pytest.fixture
def experiment(tmp_path, monkeypatch):
    """A function that writes an experiment over our kitchen and returns its path."""
    shared = tmp_path / "ref"
    (shared / "data/alfred").mkdir(parents=True)
    (shared / "data/thor5").mkdir()
    ours.write(shared / "data/thor5/scenes.jsonl.gz", ours.dump())
    ours.write(shared / "data/alfred/layouts.json.gz", ours.layout())
    monkeypatch.setenv("KARMA_SHARED", str(shared))
    types, trials = eb.types_file(tmp_path), ours.write(tmp_path / "trials.jsonl", ours.trial())
    published = tmp_path / "published.csv"
    published.write_text("model,subset,score\nDeep Thought,average,42\nDeep Thought,base,41.5\n")

    def write(rows=eb.ROWS, *, tasks=None, **changed):
        lists = {
            "base": [("ours_1", "Put the apple into the fridge."), ("ours_1", "Cool some fruit.")],
            "spatial": [("ours_1", "The apple goes into the fridge."), ("ours_1", "Chill it.")],
        }
        given = {
            name: [
                {"task": f"x/{one}", "repeat_idx": 0, "instruction": text} for one, text in found
            ]
            for name, found in (tasks or lists).items()
        }
        (tmp_path / "splits.json").write_text(json.dumps(given))
        fields = {
            "name": "x", "benchmark": "eb_alfred", "tasks": str(tmp_path / "splits.json"),
            "types": str(types), "trials": str(trials), "published": str(published), **changed,
        }  # fmt: skip
        path = tmp_path / "x.toml"
        path.write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in fields.items()) + rows)
        return path

    return write
