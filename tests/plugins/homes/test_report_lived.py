"""Runs of lived-in homes as pages: the day is lived again, told rightly, and can be watched."""

import html
import json
import re
from dataclasses import replace

import msgspec
import pytest
from support.chromium import chromium
from support.run_files import karma
from typer.testing import CliRunner

from karma.bench.engine.run import Run
from karma.bench.report.suite_pages import (
    HARD,
    chosen_day,
    curves_picture,
    lived_again,
    lived_pictures,
    read_lived,
    render_lived,
)
from karma.cli import app
from karma.errors import KarmaError
from karma.models.embed.minilm import MiniLm
from karma.plugins.homes.lived.play import HomeLife
from karma.plugins.homes.lived.reading import Reader
from karma.plugins.homes.lived.report_day import requests_of, told_day
from karma.plugins.homes.lived.request import DAY_S
from karma.plugins.homes.lived.table import ALL, by_day, figures_of, stale_shares
from karma.plugins.homes.lived.trace import HomeTracer

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
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("homes")
    (place / "small.toml").write_text(SMALL)
    list(Run(place / "small.toml", place / "run").episodes(1))
    return place / "run"


@pytest.fixture(scope="module")
def run(folder):
    return read_lived(folder)


@pytest.fixture(scope="module")
def shown(run):
    return lived_again(run, chosen_day(run, "40 %/home_070", 1, "KARMA, FIFO"))


@pytest.fixture(scope="module")
def page(run, shown):
    return render_lived(run, shown)


@pytest.fixture(scope="module")
def lives(run):
    """(a home that was traced, one that was not, the trace, records of both)."""
    one = msgspec.convert(run.header.experiment, run.benchmark.experiment_kind)
    spec = next(spec for spec in one.specs() if spec.name == "40 %/home_070")
    tracer = HomeTracer()
    made = [
        HomeLife(one, one.rows[0], spec, 0, Reader(MiniLm()), watch) for watch in (tracer, None)
    ]
    records = [[life.day(day) for day in range(2)] for life in made]
    return made[0], tracer.trace, records


def test_records_with_a_tracer_are_those_without_and_those_of_the_run(lives, run):
    _, _, (traced, plain) = lives
    assert traced == plain
    assert traced == [
        one for one in run.records if one.row == "ours" and one.task.startswith("40 %/home_070/")
    ]


def test_trace_has_every_deed_of_the_log_once_at_its_time(lives):
    life, trace, _ = lives
    log = life._household.log
    assert len(log) > 20
    assert [one.deed for one in trace.deeds] == log


def test_trace_ends_with_everything_where_the_world_has_it(lives):
    life, trace, _ = lives
    last = {one.object_id: one for one in trace.things}
    now = life.now()
    assert now.keys() <= last.keys()
    for object_id, seen in now.items():
        if last[object_id].holder:
            assert seen.place_id == "hand"
        else:
            assert last[object_id].center_m == seen.position_m
    assert all(last[gone].center_m is None for gone in last.keys() - now.keys())
    assert trace.walks[-1].end == life._household.world.state.pose


def test_trace_begins_where_things_were_at_midnight_and_walks_join(lives):
    life, trace, _ = lives
    first = {one.object_id: one.center_m for one in trace.things if one.time_s == 0.0}
    assert first == {object_id: seen.position_m for object_id, seen in life._start.items()}
    assert trace.walks[0].start == trace.start
    for one, following in zip(trace.walks, trace.walks[1:], strict=False):
        assert one.end.position_m == following.start.position_m
        assert one.begun_s < one.over_s <= following.begun_s


def test_trace_of_requests_is_that_of_the_records(lives):
    _, trace, (records, _) = lives
    for day, record in enumerate(records):
        assert tuple(one.served for one in requests_of(trace, day)) == record.requests
    for one in trace.requests:
        assert {seen.object_id for seen in one.truth} <= set(one.request.object_ids)


def test_told_day_has_the_day_only_and_things_where_they_were_left(lives):
    _, trace, _ = lives
    first, second = told_day(trace, 0), told_day(trace, 1)
    assert all(0 <= deed[0] < DAY_S for deed in first["deeds"])
    assert len(first["deeds"]) + len(second["deeds"]) == len(trace.deeds)
    ends = {one["id"]: one["at"][-1][1:] for one in first["things"]}
    begins = {one["id"]: one["at"][0] for one in second["things"]}
    assert all(begins[one][0] > DAY_S or begins[one][1:] == ends[one] for one in begins)
    for person in second["people"]:
        assert all(begun <= over for begun, over, _, _ in person["walks"])


def test_a_day_that_comes_out_otherwise_is_refused(run):
    record = chosen_day(run, "40 %/home_070", 1, "ours")
    changed = replace(record, missing=99)
    records = tuple(changed if one == record else one for one in run.records)
    wrong = replace(run, records=records)
    with pytest.raises(
        KarmaError, match=r"day_1 of 'ours'.* missing differ; (.|\n)*To fix: karma eval"
    ):
        lived_again(wrong, changed)


def test_first_choice_is_what_ours_served_wrongly(run):
    found = chosen_day(run)
    wrong = [one for one in run.records if one.row == "ours" and not one.success]
    assert found == (wrong[0] if wrong else run.records[0])


def test_pictures_draw_the_figures_of_the_run(run):
    figures = run.benchmark.results(run.records).figures
    stale = stale_shares(run.records)
    curves, *bars = [one.figure for one in lived_pictures(figures, stale)]
    assert len(bars) == 2
    for axis, kind in zip(curves.axes, HARD, strict=False):
        drawn = {
            line.get_label(): list(line.get_ydata())
            for line in axis.lines
            if not line.get_label().startswith("_")
        }
        for row in ("ours", "KARMA, FIFO"):
            shares = [
                k.right for one in figures if one.row == row for k in one.kinds if k.kind == kind
            ]
            assert drawn[row] == [share for share in shares if share is not None]
    lines = {line.get_label(): list(line.get_ydata()) for line in curves.axes[-1].lines}
    assert lines["ours"] == [one.share for one in stale if one.row == "ours"]
    heights = [bar.get_height() for bar in bars[1].axes[0].patches]
    mine = [one for one in figures if one.setting == "40 %"]
    assert heights == [k.right for one in mine for k in one.kinds if k.right is not None]


def test_curves_over_days_show_the_requests_of_each_day(run):
    records = [one for one in run.records if one.setting == "40 %"]
    picture = curves_picture("days", figures_of(by_day(records)), stale_shares(by_day(records)))
    axis = picture.figure.axes[HARD.index(ALL)]
    drawn = {line.get_label(): list(line.get_ydata()) for line in axis.lines}
    days = sorted({one.day for one in records})
    assert [label.get_text() for label in axis.get_xticklabels()] == [f"day {d + 1}" for d in days]
    for row in ("ours", "KARMA, FIFO"):
        for day, share in zip(days, drawn[row], strict=True):
            asked = [
                served.right
                for one in records
                if (one.row, one.day) == (row, day)
                for served in one.requests
            ]
            assert share == pytest.approx(sum(asked) / len(asked))


def test_stale_shares_are_those_of_the_table_with_intervals_around_them(run):
    figures = {(one.row, one.setting): one for one in run.benchmark.results(run.records).figures}
    for one in stale_shares(run.records):
        assert one.share == figures[one.row, one.setting].stale_share
        assert (one.low, one.high) == (None, None)  # two homes say nothing of others
    six = [replace(one, home=one.home + 10 * copy) for copy in range(3) for one in run.records]
    for one in stale_shares(six):
        assert one.share == pytest.approx(figures[one.row, one.setting].stale_share)
        assert one.low <= one.share <= one.high


def test_page_is_the_same_each_time_and_loads_nothing(page, run, shown):
    assert render_lived(run, shown) == page
    policy = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1])
    assert policy.startswith("default-src 'none'; img-src data:;")
    assert re.findall(r"(?:src|href)=\"(?!#|data:)", page) == []
    assert re.findall(r"@import|fetch\(|XMLHttp|WebSocket|import\(", page) == []
    assert "small &lt;i&gt;homes" in page


def test_page_lists_every_request_of_every_row(page, run):
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])
    listed = data["requests"]
    texts = [listed["text"]["values"][n] for n in listed["text"]["at"]]
    assert texts == [served.text for one in run.records for served in one.requests]
    right = [listed["right"]["values"][n] for n in listed["right"]["at"]]
    assert right == [served.right for one in run.records for served in one.requests]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--home", "40 %/home_7"], "--home '40 %/home_7'"),
        (["--row", "our"], "Did you mean 'ours'?"),
        (["--day", "9"], "--day 9: 'ours' has days 0 to 1"),
        (["--episodes", "all"], "have days, no episodes"),
    ],
)
def test_what_the_run_has_not_is_refused_with_the_command_that_helps(folder, options, said):
    got = CliRunner().invoke(app, ["report", str(folder), *options])
    words = " ".join(got.output.split())
    assert got.exit_code != 0
    assert said in words
    assert "To fix: karma report" in words


def test_a_run_without_a_day_and_a_torn_one_are_refused(folder, tmp_path):
    (tmp_path / "header.json").write_bytes((folder / "header.json").read_bytes())
    with pytest.raises(KarmaError, match=r"no day is done yet\n  To fix: karma eval"):
        read_lived(tmp_path)
    lines = (folder / "episodes.jsonl").read_bytes().split(b"\n")
    (tmp_path / "episodes.jsonl").write_bytes(b"\n".join([lines[0][:50], *lines[1:]]))
    with pytest.raises(KarmaError, match=r"episodes.jsonl: line 1: (.|\n)*To fix: take line 1 out"):
        read_lived(tmp_path)
    header = (folder / "header.json").read_text().replace('"disturbance"', '"disturbed"')
    (tmp_path / "header.json").write_text(header)
    with pytest.raises(KarmaError, match=r"header.json: experiment: (.|\n)*To fix: karma eval"):
        read_lived(tmp_path)


def test_options_of_homes_are_refused_for_other_runs(tmp_path):
    got = CliRunner().invoke(app, ["report", str(tmp_path), "--day", "1"])
    assert got.exit_code != 0
    assert "are of one run of lived-in homes" in got.output


def test_command_writes_the_page_where_it_is_told(folder, tmp_path):
    got = karma("report", folder, "--out", tmp_path / "page.html")
    assert "to watch:" in got
    assert "</html>" in (tmp_path / "page.html").read_text()


def test_browser_plays_the_day_and_filters_requests_without_asking_anybody(page, run, tmp_path):
    file = tmp_path / "page.html"
    file.write_text(page)
    with chromium(tmp_path / "profile") as tab:
        tab.open(file.as_uri())
        assert tab.value("document.getElementById('row').value") == "KARMA, FIFO"
        tab.value("document.getElementById('stage').scrollIntoView()")
        tab.press("Home")
        assert tab.value("document.getElementById('now').textContent") == "00:00:00"
        tab.press("ArrowRight")
        record = chosen_day(run, "40 %/home_070", 1, "KARMA, FIFO")
        assert record.requests[0].text in tab.value(
            "document.getElementById('request').textContent"
        )
        choose = (
            "(() => {{ const one = document.getElementById('{}'); one.value = '{}'; "
            "one.dispatchEvent(new Event('input')); }})()"
        )
        for name in ("outcome", "row", "kind"):
            tab.value(choose.format(name, ""))
        total = sum(len(one.requests) for one in run.records)
        assert tab.value("document.getElementById('found').textContent") == f"{total} of {total}"
        tab.value(choose.format("kind", "changed"))
        tab.value(choose.format("outcome", "wrongly"))
        served = [one for record in run.records for one in record.requests]
        wrong = sum(one.kind == "changed" and not one.right for one in served)
        assert tab.value("document.getElementById('found').textContent").startswith(f"{wrong} of")
        assert tab.complaints() == []
        assert tab.requests() == [file.as_uri()]
