"""What leaves a run for other programs holds whatever the records hold."""

import csv
import io

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.made_records import episode, runs, sub, write_run

from karma.bench.engine.export import to_csv
from karma.bench.figures.columns import figures

HOSTILE = st.text(max_size=30) | st.sampled_from(
    ("\x00\x1b[31m", "]]>", "<failure/>", "&lt;", "\ud7ff\ufffe", '",\n"', "=1+1", "\u202e")
)


def lines_of(folder):
    return list(csv.DictReader(io.StringIO(to_csv(folder).decode(), newline="")))


@settings(deadline=None, max_examples=40, suppress_health_check=list(HealthCheck))
@given(row=HOSTILE, task=HOSTILE, error=HOSTILE, instruction=HOSTILE)
def test_any_text_stays_text_in_csv(tmp_path_factory, row, task, error, instruction):
    """Nothing that a planner, a task or a row says opens a cell or a line."""
    records = [
        episode(sub("A: 1", unmet=True, instruction=instruction), row=row, task=task),
        episode(sub("A: 1"), row=row, task=task, seed=1, error=error),
    ]
    folder = write_run(tmp_path_factory.mktemp("hostile") / "run", records)
    assert [(line["row"], line["task"], line["error"]) for line in lines_of(folder)] == [
        (row, task, ""),
        (row, task, error),
    ]


@settings(deadline=None, max_examples=30, suppress_health_check=list(HealthCheck))
@given(records=runs())
def test_counts_are_those_of_the_figures(tmp_path_factory, records):
    folder = write_run(tmp_path_factory.mktemp("counted") / "run", records)
    lines = lines_of(folder)
    for line in figures(records):
        if line.kind == "all":
            mine = [one for one in lines if one["row"] == line.row]
            assert sum(one["succeeded"] == "True" for one in mine) == line.successes
            assert sum(float(one["success"]) for one in mine) == line.successes
