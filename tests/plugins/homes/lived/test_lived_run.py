"""A run of lived-in homes: the same bytes however it is run, and what its table says."""

import pytest

from karma.bench.engine.benchmark_runs import read_results
from karma.bench.engine.run import Run
from karma.errors import KarmaError
from karma.plugins.homes.lived.body import HomeRobot
from karma.plugins.homes.lived.table import figures_of
from karma.plugins.homes.residents import Household
from karma.world.core.navigate import path as cells_path
from tests.support.lived import small_home, small_map

SMALL = """
name = "small"
benchmark = "lived"
homes = 2
days = 1
first_home = 70
settings = [{ name = "usual", rooms = [2] }]
rows = [
    { name = "ours", design = "ours" },
    { name = "KARMA, FIFO", design = "karma-fifo" },
    { name = "expert", design = "expert" },
]
"""


def played(folder, workers=1, text=SMALL):
    folder.mkdir(exist_ok=True)
    file = folder / "small.toml"
    file.write_text(text)
    run = Run(file, folder / "run")
    list(run.episodes(workers))
    return run


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return played(tmp_path_factory.mktemp("whole"))


def test_two_workers_write_the_same_bytes(whole, tmp_path):
    other = played(tmp_path, workers=2)
    for name in ("episodes.jsonl", "results.json", "table.md"):
        assert (other.folder / name).read_bytes() == (whole.folder / name).read_bytes()


def test_a_run_that_was_cut_off_goes_on_to_the_same_bytes(whole, tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(SMALL)
    first = Run(file, tmp_path / "run")
    for number, _ in enumerate(first.episodes(1)):
        if number == 4:
            break
    again = Run(file, tmp_path / "run")
    list(again.episodes(1))
    mine, theirs = tmp_path / "run/episodes.jsonl", whole.folder / "episodes.jsonl"
    assert mine.read_bytes() == theirs.read_bytes()


def test_the_table_has_every_row_and_the_expert_is_best(whole):
    figures = {one.row: one for one in figures_of(whole.records)}
    assert list(figures) == ["ours", "KARMA, FIFO", "expert"]
    right = {row: one.kinds[-1].right for row, one in figures.items()}
    assert right["expert"] > 0.9
    assert right["expert"] >= right["ours"] > right["KARMA, FIFO"]
    results = read_results(whole.folder)
    assert results.table.lines[0][0] == "ours"
    assert all(one.days == 2 and one.homes == 2 and not one.errors for one in figures.values())


def test_an_unknown_design_is_refused_by_name(tmp_path):
    with pytest.raises(KarmaError, match="there is no 'mine'"):
        played(tmp_path, text=SMALL.replace('design = "ours"', 'design = "mine"'))


def test_walks_cost_what_the_shortest_way_takes():
    household = Household(small_home(), seed=0, people=0, disturbance=0.0)
    robot, state = HomeRobot(household, small_map(), lambda moment: None), household.world.state
    for place_id, spots in list(robot.map.spots.items())[:12]:
        ways = []
        for pose in spots:
            start, end = (
                state.room.key(one.position_m[0], one.position_m[2]) for one in (state.pose, pose)
            )
            ways.append(len(cells_path(state.cells, start, end)) - 1)
        turns = robot.way(place_id) - min(ways)
        assert 0 <= turns <= max(ways) + 6  # quarter turns and tilts


def test_things_that_find_no_room_are_said(tmp_path, whole):
    assert "did not find room" not in (whole.folder / "table.md").read_text()
    text = (
        SMALL.replace("rooms = [2] }", "rooms = [2], things = 1000 }")
        .replace('{ name = "ours", design = "ours" },', "")
        .replace('{ name = "KARMA, FIFO", design = "karma-fifo" },', "")
    )
    text = text.replace("homes = 2", "homes = 1")
    table = (played(tmp_path, text=text).folder / "table.md").read_text()
    assert "usual: things = 1,000 did not find room; homes have" in table
