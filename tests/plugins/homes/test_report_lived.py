"""The page of a run of lived-in homes."""

import pytest
from support.run_files import karma

from karma.bench.engine.run import Run
from karma.bench.report.suite_pages import benchmark_page
from karma.errors import KarmaError

SMALL = """
name = "small <i>homes</i>"
benchmark = "lived"
homes = 2
days = 2
first_home = 70
settings = [
    { name = "0 %", rooms = [2], disturbance = 0.0 },
    { name = "40 %", rooms = [2], disturbance = 0.4 },
]
rows = [
    { name = "ours", design = "ours" },
    { name = "KARMA, FIFO", design = "karma-fifo" },
]
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    place = tmp_path_factory.mktemp("homes")
    (place / "small.toml").write_text(SMALL)
    run = Run(place / "small.toml", place / "run")
    list(run.episodes(1))
    return run


def test_page_has_the_tables_and_a_picture_over_settings_and_for_each(run):
    karma("report", run.folder)
    page = (run.folder / "report.html").read_text(encoding="utf-8")
    assert "<h1>small &lt;i&gt;homes&lt;/i&gt;</h1>" in page
    assert page.count("data:image/svg+xml;base64,") == 3
    for words in ("Over settings", "Served rightly, by kind: 40 %", "KARMA, FIFO"):
        assert words in page
    assert page == benchmark_page(run.folder)


def test_one_setting_is_drawn_over_the_days(run):
    benchmark = run.suite.benchmark
    records = [one for one in run.records if one.setting == "0 %"]
    assert [one.title for one in benchmark.pictures(records)] == [
        "Served rightly, by kind: 0 %",
        "Over days lived",
    ]
    assert len(benchmark.pictures([one for one in records if one.day == 0])) == 1


def test_run_without_a_day_is_named(run, tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    empty = Run(tmp_path / "small.toml", tmp_path / "run")
    with pytest.raises(KarmaError, match="karma eval"):
        benchmark_page(empty.folder)
