"""Faults of the surroundings in the midst of a run: told, counted as nobody's, done again."""

import pytest
from support.run_files import ONLY, files, plant_plugin, write_experiment
from typer.testing import CliRunner

from karma.cli import app
from karma.journal.folder import RESULTS
from karma.journal.run_folder import read_run

FLAKY = """
from pathlib import Path
from karma.errors import WorldLost
from karma.world.sim import EmbeddedWorld

LEFT = Path(__file__).with_name("left")  # steps before it dies; without the file it lives

class Flaky(EmbeddedWorld):
    def step(self, action, **arguments):
        if LEFT.exists():
            left = int(LEFT.read_text())
            if not left:
                raise WorldLost("it died", during=str(action), log=LEFT.with_name("player.log"))
            LEFT.write_text(str(left - 1))
        return super().step(action, **arguments)
"""


@pytest.fixture
def steps_left(tmp_path, monkeypatch):
    """A file of how many steps an installed world, `flaky`, has before it dies."""
    place = tmp_path / "plugin"
    plant_plugin(place, "flaky_world", FLAKY, "worlds", "flaky = flaky_world:Flaky")
    monkeypatch.syspath_prepend(str(place))
    return place / "left"


@pytest.mark.parametrize(("workers", "steps"), [("1", 150), ("2", 0)])
def test_lost_simulator_is_told_and_its_episode_done_again_by_the_same_command(
    steps_left, tmp_path, workers, steps
):
    rows = '[[rows]]\nname = "expert"\nmethod = "expert"\n'
    more = 'world = "flaky"\nseeds = [0, 1]'
    path = write_experiment(tmp_path / "x.toml", "karma-nano", rows=rows, more=more)

    def told(folder):
        command = ["eval", str(path), "--out", str(folder), "--workers", workers]
        return CliRunner().invoke(app, command)

    assert told(tmp_path / "whole").exit_code == 0
    folder = tmp_path / "cut"
    steps_left.write_text(str(steps))
    lost = told(folder)
    assert lost.exit_code == 1, lost.output
    assert "the simulator is lost, during" in lost.output
    assert "it died" in lost.output
    kept = read_run(folder)
    assert not (folder / RESULTS).exists()
    assert len(kept.records) < 2 * len(ONLY)
    assert all(record.success for record in kept.records)
    steps_left.unlink()
    assert told(folder).exit_code == 0
    assert files(folder) == files(tmp_path / "whole")
