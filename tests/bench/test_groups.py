"""Tasks of others' benchmarks: counted by their lists, and by what stands in training data."""

from dataclasses import replace

import pytest
from support.made_records import plain, write_run

from karma.bench.figures.columns import figures
from karma.bench.figures.results import result_of
from karma.bench.figures.tables import main_sheets, sheets
from karma.cli import show
from karma.journal.records import ALL, NOT_TRAINED, TRAINED, kinds_of
from karma.journal.run_folder import read_run


def made(*, apart=True):
    """KARMA solves both tasks of "spatial" and one of four of "base"; one task is trained on."""
    solved = {"base/0": True, "base/1": False, "base/2": False, "base/3": False,
              "spatial/0": True, "spatial/1": True}  # fmt: skip
    return [
        replace(
            plain(solved[task] or row == "expert", row=row, task=task, kind=task.partition("/")[0]),
            trained=(task == "base/0") if apart else None,
        )
        for row in ("KARMA", "expert")
        for task in solved
    ]


def result(folder, records):
    return result_of(read_run(write_run(folder / "run", records, name="lists")), {})


def values(records, row="KARMA"):
    return {one.kind: one.values["success"].value for one in figures(records) if one.row == row}


def test_lists_are_counted_apart_and_so_is_what_stands_in_training_data():
    assert values(made()) == {
        "base": 0.25, "spatial": 1.0, ALL: 0.5, TRAINED: 1.0, NOT_TRAINED: 0.4
    }  # fmt: skip


def test_records_of_unknown_training_data_are_not_split():
    assert set(values(made(apart=False))) == {"base", "spatial", ALL}


def test_paper_kinds_come_before_groups_of_others():
    records = [plain(True, task=kind, kind=kind) for kind in ("zoo", "base", "complex", "simple")]
    assert kinds_of(records) == ("simple", "complex", "zoo", "base")


def test_table_of_others_says_so_and_has_no_published_column(tmp_path):
    (sheet,) = main_sheets(result(tmp_path, made()))
    assert "our skills, another protocol" in sheet.title
    assert "Not to be held against scores measured by the benchmark's own protocol" in sheet.caption
    assert sheet.head == (
        "method", "all", "mean", "base", "spatial", "in training (1)", "not in training (5)"
    )  # fmt: skip
    karma, expert = sheet.lines
    assert [cell.split()[0] for cell in karma] == [
        "KARMA", "0.50", "0.62", "0.25", "1.00", "1.00", "0.40"
    ]  # fmt: skip
    assert {cell.split()[0] for cell in expert[1:]} == {"1.00"}
    assert sheets(result(tmp_path / "again", made()))[0] == sheet


def test_table_of_others_says_where_training_data_is_unknown(tmp_path):
    (sheet,) = main_sheets(result(tmp_path, made(apart=False)))
    assert sheet.head == ("method", "all", "mean", "base", "spatial")
    assert sheet.caption.endswith("is not known.")


@pytest.mark.parametrize("apart", [True, False])
def test_figures_of_lists_stand_on_the_terminal(tmp_path, apart):
    found = result(tmp_path, made(apart=apart))
    wanted = ["base", "spatial", ALL, *([TRAINED, NOT_TRAINED] if apart else [])]
    assert [line.kind for line in found.figures] == [*wanted, *wanted]
    assert show.summary_table(found.figures, "lists").row_count == 2 * len(wanted)


def test_causes_of_failure_are_counted_by_list(tmp_path):
    causes = [s for s in sheets(result(tmp_path, made())) if "first failed sub-task" in s.title]
    counts = {line[:2]: line[2] for line in causes[0].lines}
    assert counts["KARMA", "base"] == counts["KARMA", ALL] == "3"
    assert ("KARMA", TRAINED) not in counts
