"""The laboratory's costs, claims and figures.

Covered: figures that are killed and go on, verdicts on made-up results, the command.
"""

from shutil import copytree

import pytest
from msgspec.structs import replace
from support.paths import ROOT

from karma.bench.engine.experiment_file import kind_of
from karma.bench.policies.figure import TraceFigure, drawn, figure_run, read_figure
from karma.bench.policies.paper_claims import FigureCell, claims_of, claims_text
from karma.bench.policies.simulate import Trace
from karma.bench.policies.sweep import (
    Bootstrapped,
    Exploration,
    PolicyRow,
    Sweep,
    explore,
    sized,
)
from karma.bench.policies.tasks import WORKLOADS
from karma.errors import FileError, KarmaError, UnknownNameError
from karma.files import read_toml
from karma.journal.folder import EPISODES, MARK, RESULTS, TIMINGS

PAPER = sorted((ROOT / "eval" / "paper").glob("fig*.toml"))


# ----------------------------------------------------------------- exploration and claims


def test_saved_exploration_is_the_hit_rate_where_all_costs_are_equal():
    traces = [Trace.of((key,) for key in keys) for keys in ("aabb", "abab", "aaaa", "abcd")]
    found = explore("lru[1]", traces, [[2.0] * 4] * 4, 0)
    assert found.reduced == found.rates == [0.5, 0.0, 0.75, 0.0]
    assert (found.slope, found.intercept, found.r.value) == (1, 0, 1)


def made_row(policy, size, hits):
    """A row of made-up hits; six sequences or more, as fewer have no interval."""
    cold = Bootstrapped(value=sum(hits) / 100 / len(hits))
    return PolicyRow(
        policy=policy, size=size, cold=cold, first=None, steady=None, warm=None, hits=hits,
        steady_hits=[hit // 2 for hit in hits], left=None, warm_task=None, curve=[],
    )  # fmt: skip


def made_cell(rows):
    count = len(rows[0].hits)
    sweep = Sweep(requests=[100] * count, steady_requests=[50] * count, units=9.0, interval="none",
                  rows=rows)  # fmt: skip
    return FigureCell(workload="type", unit_set="r4", sweep=sweep)


@pytest.mark.parametrize(
    "nine, eight, fifo, holds",
    [
        ([60, 62, 61], [50, 51, 52], [40, 45, 41], "yes"),
        ([60, 62, 61], [50, 51, 52], [70, 75, 71], "no"),
        ([60, 62, 61], [70, 71, 72], [40, 45, 41], "no"),
        ([60, 62, 61], [60, 62, 61], [40, 45, 41], "tie"),
        ([60, 62, 61], [50, 70, 52], [40, 45, 41], "tie"),
    ],
)
def test_best_split_must_beat_every_other_one_and_fifo(nine, eight, fifo, holds):
    rows = [made_row("wtinylfu-karma[9,1] W=9", 10, 2 * nine),
            made_row("wtinylfu-karma[8,2] W=9", 10, 2 * eight),
            made_row("wtinylfu-caffeine[8,2]", 10, 6 * [99]),
            made_row("fifo-merge[10]", 10, 2 * fifo)]  # fmt: skip
    (claim,) = claims_of(["split"], [made_cell(rows)])
    assert (claim.policy, claim.holds) == ("wtinylfu-karma W=9", holds)


@pytest.mark.parametrize("large, holds", [([46, 92, 69], "yes"), ([40, 80, 60], "no")])
def test_ratio_of_sizes_is_held_against_the_published_one(large, holds):
    rows = [made_row("fifo-merge[5]", 5, 2 * [10, 20, 15]),
            made_row("fifo-merge[25]", 25, 2 * large),
            made_row("belady[5]", 5, 6 * [20]), made_row("belady[25]", 25, 6 * [40]),
            made_row("wtinylfu-karma[4,1]", 5, 2 * [10, 20, 15]),
            made_row("wtinylfu-karma[23,2]", 25, 2 * [39, 78, 58])]  # fmt: skip
    fifo, other = claims_of(["fifo-ratio", "wtinylfu-ratio"], [made_cell(rows)])
    assert (fifo.policy, fifo.holds) == ("fifo-merge", holds)
    assert dict(fifo.figures)["Belady's ratio"].startswith("2.00")
    assert (other.policy, other.holds) == ("wtinylfu-karma 9/1", "yes")
    assert "| type | R4 | wtinylfu-karma 9/1 |" in claims_text([fifo, other], "made up")


@pytest.mark.parametrize(
    "r, holds", [((0.85, 0.9, 0.95), "yes"), ((0.7, 0.79, 0.85), "tie"), ((0.1, 0.3, 0.5), "no")]
)
def test_line_is_a_line_where_the_interval_says_so(r, holds):
    low, value, high = r
    r = Bootstrapped(value=value, low=low, high=high)
    found = Exploration(
        policy="lru[5]", rates=[0.1, 0.2], reduced=[0.1, 0.3], slope=2.0, intercept=-0.1, r=r
    )
    cell = replace(made_cell([made_row("lru[5]", 5, [10, 20])]), exploration=[found])
    (claim,) = claims_of(["linear"], [cell])
    assert (claim.holds, dict(claim.figures)["hit rate"]) == (holds, "15.0")


# ----------------------------------------------------------------- figures

SMALL = """
kind = "trace"
name = "small"
claims = ["split", "headroom"]
workloads = ["type", "rooms"]
unit_sets = ["m"]
policies = ["fifo-merge[10]", "wtinylfu-karma[9,1]", "wtinylfu-karma[5,5]", "arc[10]"]
sequences = 4
length = 60
checkpoints = [10, 60]
"""


@pytest.fixture
def small(tmp_path, whole):
    """The experiment, for a test to change, over the same tasks."""
    path = tmp_path / "small.toml"
    path.write_text(whole.with_name("small.toml").read_text("utf-8"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A finished figure, to be read or copied, with its experiment beside it."""
    place = tmp_path_factory.mktemp("whole")
    (place / "small.toml").write_text(SMALL, encoding="utf-8")
    run = figure_run(place / "small.toml", place / "out")
    assert len(list(run.episodes())) == run.total == 2 * 5
    return place / "out"


def files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != TIMINGS
    }


def test_figure_that_was_killed_goes_on_to_the_same_bytes(small, whole, tmp_path):
    for kill_at in (2, 8):
        folder = tmp_path / f"killed-{kill_at}"
        going = figure_run(small, folder).episodes()
        for _ in range(kill_at):
            next(going)
        going.close()
        kept = kill_at // 5  # cells
        assert len(list(figure_run(small, folder).episodes())) == (2 - kept) * 5
        assert files(folder) == files(whole)


def test_figure_by_two_workers_has_the_same_bytes(small, whole, tmp_path):
    list(figure_run(small, tmp_path / "two").episodes(2))
    assert files(tmp_path / "two") == files(whole)


def test_figure_that_was_edited_is_drawn_by_nobody(small, whole, tmp_path):
    copytree(whole, tmp_path / "one")
    mark = (tmp_path / "one" / MARK).read_bytes()
    assert list(figure_run(small, tmp_path / "one").episodes()) == []
    assert (tmp_path / "one" / MARK).read_bytes() == mark
    for place in (tmp_path / "one" / EPISODES, tmp_path / "one" / RESULTS):
        whole = place.read_bytes()
        place.write_bytes(whole.replace(b"0", b"1", 1))
        for again in (
            lambda: read_figure(tmp_path / "one"),
            lambda: list(figure_run(small, tmp_path / "one").episodes()),
        ):
            with pytest.raises(FileError, match=f"{place.name}: is not as it was left"):
                again()
        place.write_bytes(whole)
    assert read_figure(tmp_path / "one")


def test_figure_draws_and_states_its_claims(whole, tmp_path):
    copytree(whole, tmp_path / "out")
    results = read_figure(tmp_path / "out")
    assert [(cell.workload, cell.unit_set) for cell in results.cells] == [
        ("type", "m"),
        ("rooms", "m"),
    ]
    for cell in results.cells:
        bound = next(row for row in cell.sweep.rows if row.policy == "belady[10]")
        assert all(
            hits <= most
            for row in cell.sweep.rows
            for hits, most in zip(row.hits, bound.hits, strict=True)
        )
    assert {claim.claim for claim in results.claims} == {"split", "headroom"}
    made = drawn(results)
    assert set(made) == {"figure-m.png", "figure-m.svg", "claims.md"}
    assert made == {name: (tmp_path / "out" / name).read_bytes() for name in made}
    for name, start in (("figure-m.svg", b"<?xml"), ("figure-m.png", b"\x89PNG\r")):
        assert made[name].startswith(start)
    assert "4 sequences of 60 tasks" in (tmp_path / "out" / "claims.md").read_text("utf-8")


def test_figure_of_exploration_has_a_line_for_each_policy(small, tmp_path):
    text = small.read_text("utf-8").replace('name = "small"', 'name = "x"\nshows = "exploration"')
    small.write_text(text.replace('"split", "headroom"', '"linear"'), encoding="utf-8")
    list(figure_run(small, tmp_path / "out").episodes())
    results = read_figure(tmp_path / "out")
    assert all(len(cell.exploration) == 5 for cell in results.cells)
    assert all(0 <= one <= 1 for c in results.cells for e in c.exploration for one in e.reduced)
    assert len(results.claims) == 2 * 4  # not of the bound


@pytest.mark.parametrize(
    "change, error, says",
    [
        (('claims = ["split"', 'claims = ["splat"'), KarmaError, "no claim 'splat'"),
        (('"arc[10]"', '"ark[10]"'), UnknownNameError, "arc"),
        (("length = 60", "length = 0"), FileError, "Expected `int` >= 1 - at `\\$.length`"),
        (('"rooms"]', '"attic"]'), FileError, "attic"),
        (('kind = "trace"', 'kind = "trace"\nfoo = 1'), FileError, "foo"),
    ],
)
def test_figures_that_make_no_sense_are_refused_at_once(small, tmp_path, change, error, says):
    small.write_text(small.read_text("utf-8").replace(*change), encoding="utf-8")
    with pytest.raises(error, match=says):
        figure_run(small, tmp_path / "out")


def test_missing_tasks_are_an_error_or_said_aloud(small, tmp_path):
    text = small.read_text("utf-8") + 'tasks = ["gone.jsonl.gz"]\n'
    small.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=r"gone\.jsonl\.gz"):
        figure_run(small, tmp_path / "out")
    text = text.replace("sequences = 4", 'sequences = 2\notherwise = "grammar"')
    small.write_text(text, encoding="utf-8")
    list(figure_run(small, tmp_path / "out").episodes())
    assert read_figure(tmp_path / "out").source.startswith("our task grammar")


@pytest.mark.parametrize("path", PAPER, ids=lambda path: path.stem)
def test_figures_of_the_paper_name_policies_and_claims_there_are(path):
    figure = read_toml(path, TraceFigure)
    assert kind_of(path) == "figure"
    assert len(sized(figure.policies, figure.sizes)) > 1
    assert claims_of(figure.claims, []) == []
    assert figure.workloads == WORKLOADS
