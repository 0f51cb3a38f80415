"""What leaves a run for other programs holds whatever the records hold."""

import csv
import io

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.made_records import episode, plain, runs, sub, write_run

from karma.bench.engine.export import to_csv
from karma.bench.figures.columns import figures
from karma.bench.figures.floors import SuccessFloor, below, check_floors
from karma.errors import KarmaError

HOSTILE = st.text(max_size=30) | st.sampled_from(
    ("\x00\x1b[31m", "]]>", "<failure/>", "&lt;", "\ud7ff\ufffe", '",\n"', "=1+1", "\u202e")
)


@settings(deadline=None, max_examples=40, suppress_health_check=list(HealthCheck))
@given(row=HOSTILE, task=HOSTILE, error=HOSTILE, instruction=HOSTILE)
def test_any_text_stays_text_in_csv(tmp_path_factory, row, task, error, instruction):
    """Nothing that a planner, a task or a row says opens a cell or a line."""
    records = [
        episode(sub("A: 1", unmet=True, instruction=instruction), row=row, task=task),
        episode(sub("A: 1"), row=row, task=task, seed=1, error=error),
    ]
    folder = write_run(tmp_path_factory.mktemp("hostile") / "run", records)
    lines = list(csv.DictReader(io.StringIO(to_csv(folder).decode(), newline="")))
    assert [(line["row"], line["task"], line["error"]) for line in lines] == [
        (row, task, ""),
        (row, task, error),
    ]


@settings(deadline=None, max_examples=30, suppress_health_check=list(HealthCheck))
@given(records=runs())
def test_counts_of_the_csv_are_those_of_the_figures(tmp_path_factory, records):
    folder = write_run(tmp_path_factory.mktemp("counted") / "run", records)
    lines = list(csv.DictReader(io.StringIO(to_csv(folder).decode(), newline="")))
    for line in figures(records):
        if line.kind == "all":
            mine = [one for one in lines if one["row"] == line.row]
            assert sum(one["succeeded"] == "True" for one in mine) == line.successes
            assert sum(float(one["success"]) for one in mine) == line.successes


@given(solved=st.lists(st.booleans(), min_size=1, max_size=12), rate=st.integers(0, 100))
def test_floor_is_missed_exactly_where_fewer_succeeded(solved, rate):
    records = [plain(one, task=f"t{number}") for number, one in enumerate(solved)]
    missed = below(figures(records), [SuccessFloor(rate=rate / 100)])
    assert bool(missed) == (sum(solved) * 100 < rate * len(solved))


def test_floor_of_a_row_looks_at_that_row_only():
    records = [plain(True, row="a"), plain(False, row="b")]
    floors = [SuccessFloor.of("a=1"), SuccessFloor.of("0.5"), SuccessFloor.of("b=0.1")]
    assert below(figures(records), floors) == ["success of b: 0.000 (0 of 1), below 0.1"]
    assert below(figures([]), [SuccessFloor.of("0")]) == [
        "success of all rows: none (0 of 0), below 0"
    ]


@pytest.mark.parametrize("text", ["2", "-0.1", "x", "", "a=", "a=nan", "inf"])
def test_floor_that_is_no_rate_is_refused(text):
    with pytest.raises(KarmaError, match="a rate is from 0 to 1"):
        SuccessFloor.of(text)


def test_floor_of_no_row_names_the_nearest():
    with pytest.raises(KarmaError, match=r"no row 'KRMA'\. Did you mean 'KARMA'"):
        check_floors([SuccessFloor.of("KRMA=1")], ["KARMA", "HELPER"])
