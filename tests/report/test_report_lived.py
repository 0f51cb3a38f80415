"""The page of lived-in homes: its days are the run's, its pictures the run's figures."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from karma.benchmarks.lived.experiment import LivedExperiment
from karma.benchmarks.lived.play import HomeLife, player
from karma.benchmarks.lived.trace import DayWatch, trace_day
from karma.benchmarks.run import BenchmarkRun
from karma.cli import app
from karma.errors import KarmaError
from karma.files import read_toml
from karma.household.places import HAND
from karma.infer.embed.minilm import MiniLm
from karma.report.lived import is_lived, lived_page
from karma.tasks.lived import Reader

SMALL = """
name = "small_page"
benchmark = "lived"
homes = 1
days = 2
first_home = 71
settings = [{ name = "usual", rooms = [2], people = 2 }]
rows = [{ name = "ours", design = "ours" }, { name = "KARMA, LRU", design = "karma-lru" }]
"""
HOME = "usual/home_071"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lived_page")
    file = folder / "small.toml"
    file.write_text(SMALL)
    found = BenchmarkRun(file, folder / "run")
    list(found.episodes(1))
    return found


@pytest.fixture(scope="module")
def words():
    embedder = MiniLm()
    return embedder, Reader(embedder)


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


def page_of(folder, wanted=""):
    *parts, page = lived_page(folder, wanted)
    assert all(0 <= part <= 1 for part in parts)
    return page


def traced(run, words, day, row=0):
    experiment = run.experiment
    mine = [one for one in run.records if one.row == experiment.rows[row].name]
    return trace_day(experiment, experiment.rows[row], next(experiment.specs()), 0, day, *words,
                     expected=mine)  # fmt: skip


def test_watching_changes_nothing_and_writes_every_deed_down_once(run, words):
    spec = next(run.experiment.specs())
    life = HomeLife(run.experiment, run.experiment.rows[0], spec, 0, *words)
    watch = DayWatch(life.robot)
    life.watch(watch)
    records = [life.day(day) for day in range(2)]
    log = life.robot.household.log
    ends = {one.object_id: one for one in life.now().values() if one.place_id != HAND}
    life.close()
    assert records == list(player(run.experiment, *words)("ours", HOME, 0))
    told = [(one.time_s, one.who, one.action, one.object_id, one.place_id) for one in watch.deeds]
    assert told == [(d.time_s, d.who, d.action, d.object_id, d.place_id) for d in log]
    last = {one.object_id: one for one in watch.deeds if one.action == "PutObject"}
    assert len(last) > 5
    for object_id, deed in last.items():
        x, _, z = ends[object_id].position_m
        assert (deed.x_m, deed.z_m) == pytest.approx((x, z), abs=0.05)


def test_a_day_is_traced_as_it_was_recorded(run, words):
    day = traced(run, words, 1)
    assert day.record == run.records[1]
    assert [one.served for one in day.requests] == list(day.record.requests)
    times = [step.time_s for step in day.steps]
    assert times == sorted(times)
    assert 86_400 <= times[0] <= times[-1] <= 2 * 86_400 + 3_600
    for one in day.requests:
        if one.served.knew:
            assert one.believed.object_id in {thing.object_id for thing in one.truth}


def test_a_run_of_another_version_is_told_by_the_day(run, words):
    other = run.experiment.__class__(
        name="other", benchmark="lived", rows=run.experiment.rows, homes=1, days=2, requests=5,
        first_home=71, settings=run.experiment.settings,
    )  # fmt: skip
    mine = [one for one in run.records if one.row == "ours"]
    with pytest.raises(KarmaError, match=r"day_0 of row 'ours' comes out otherwise(?s:.*)To fix"):
        trace_day(other, other.rows[0], next(other.specs()), 0, 0, *words, expected=mine)


def test_the_page_opens_at_a_day_of_ours_and_loads_nothing(run):
    page = page_of(run.folder)
    assert is_lived(run.folder)
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)
    (day,) = data_of(page)
    record = next((one for one in run.records if one.row == "ours" and not one.success),
                  run.records[0])  # fmt: skip
    assert [one["text"] for one in day["requests"]] == [one.text for one in record.requests]
    assert page.count('<td class="mark good">') >= sum(one.right for one in record.requests)
    things = {one[0] for one in day["things"]}
    assert all(deed[3] in things for deed in day["deeds"] if deed[2] == "PutObject")


def test_days_are_chosen_by_their_names(run):
    (day,) = data_of(page_of(run.folder, f"KARMA, LRU/{HOME}/day_1/0"))
    assert day["begin"] == 86_400
    assert len(data_of(page_of(run.folder, f"{HOME}/day_1"))) == 2
    with pytest.raises(KarmaError, match="--episodes 'home_99'"):
        page_of(run.folder, "home_99")


def test_the_command_writes_the_page_and_says_what_is_torn(run, tmp_path):
    out = tmp_path / "page.html"
    done = CliRunner().invoke(app, ["report", str(run.folder), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "small_page" in out.read_text()
    torn = tmp_path / "torn"
    torn.mkdir()
    for name in ("header.json", "episodes.jsonl"):
        (torn / name).write_bytes((run.folder / name).read_bytes())
    (torn / "episodes.jsonl").write_text('{"row": 3}\n')
    done = CliRunner().invoke(app, ["report", str(torn)])
    assert done.exit_code != 0
    assert "episodes.jsonl" in done.output
    assert not (torn / "report.html").exists()


def test_every_experiment_of_lived_homes_is_read():
    for path in sorted(Path("eval/lived").glob("*.toml")):
        assert read_toml(path, LivedExperiment).rows, path
