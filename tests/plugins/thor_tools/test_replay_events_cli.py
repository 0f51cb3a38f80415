"""`karma world replay-events`: lines and files."""

import json

from support import alfred_kitchen as ours
from support.household import kitchen
from typer.testing import CliRunner

from karma.cli import app
from karma.world.sim import EmbeddedWorld


def karma(*arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.output


def recording(tmp_path):
    world = EmbeddedWorld(kitchen())
    rows = [{"action": {"action": "Initialize"}, "metadata": world.last_event.metadata}]
    for action in ({"action": "RotateRight"}, {"action": "LookDown"}):
        rows.append({"action": action, "metadata": world.step(action).metadata})
    return ours.write(tmp_path / "session.jsonl", *rows)


def test_replay_events_compares_flags_and_counts_in_the_last_line(tmp_path):
    path = recording(tmp_path)
    text = karma("world", "replay-events", path, "--json", tmp_path / "out.json").splitlines()
    (report,) = json.loads((tmp_path / "out.json").read_text())
    assert text[-1] == f"events 1, flags {report['compared']}, equal 100.00 %"
    assert report["differences"] == []
