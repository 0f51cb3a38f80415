"""The paper's tables from a run, as Markdown and CSV, beside the published figures."""

import csv
import io
import re
from dataclasses import replace

import pytest
from support.made_records import plain, write_run
from support.paths import ROOT
from support.run_files import karma

from karma.bench.engine.experiment_file import read_experiment
from karma.bench.figures.columns import COLUMNS
from karma.bench.figures.results import load_published, margins, result_of, to_csv
from karma.bench.figures.tables import (
    PUBLISHED_COLUMNS,
    sheets,
    to_markdown,
)
from karma.journal.folder import RESULTS
from karma.journal.run_folder import read_run

PAPER = ROOT / "eval" / "paper"
PUBLISHED = load_published()


@pytest.fixture
def run(tmp_path):
    """A run of three rows over four tasks of two kinds and two seeds."""
    records = [
        plain(
            row == "KARMA" or (task == "t1" and row == "memory off"),
            places={"KARMA": 2, "memory off": 10, "expert | &": 0}[row],
            row=row, task=task, kind="simple" if task in ("t1", "t2") else "complex", seed=seed,
        )
        for seed in (0, 1)
        for row in ("KARMA", "memory off", "expert | &")
        for task in ("t1", "t2", "t3", "t4")
    ]  # fmt: skip
    return read_run(write_run(tmp_path / "run", records, name="table_1"))


@pytest.fixture
def result(run):
    return result_of(run, PUBLISHED)


def rows_of(markdown, title):
    """Return a Markdown table's rows as dictionaries."""
    part = markdown.split(f"### {title}\n", 1)[1].split("###")[0]
    lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in part.splitlines() if line[:1] == "|"]
    head, _, *body = [[cell.strip() for cell in line] for line in lines]
    assert all(len(line) == len(head) for line in body)
    return [list(zip(head, line, strict=True)) for line in body]


def test_markdown_sets_ours_beside_the_published(result):
    first, second, third = rows_of(to_markdown(sheets(result)), "table_1: simple tasks")
    assert first[0] == ("method", "KARMA")
    assert first[1:3] == [("SR", "1.00 [0.34, 1.00]"), ("published", "0.42")]
    assert first[5:7] == [("RE", "0.80"), ("published", "0.582")]
    assert ("MRA", "–") in first
    assert second[1:3] == [("SR", "0.50 [0.09, 0.91]"), ("published", "–")]
    assert third[0] == ("method", r"expert \| &")


def test_sheets_compare_the_first_row_with_every_other(result):
    (sheet,) = [one for one in sheets(result) if one.title == "Success compared"]
    assert [line[:3] for line in sheet.lines] == [
        ("KARMA", other, kind)
        for other in ("memory off", "expert | &")
        for kind in ("all", "simple", "complex")
    ]
    assert sheet.lines[0][3] == "8 (4 × 2)"


def test_csv_has_every_metric_of_every_row(result):
    rows = list(csv.DictReader(io.StringIO(to_csv(result))))
    assert len(rows) == 3 * 3 * len(COLUMNS)
    one = next(
        r for r in rows if (r["row"], r["kind"], r["metric"]) == ("KARMA", "simple", "success")
    )
    assert (one["value"], one["published"], one["episodes"], one["seeds"]) == (
        "1",
        "0.42",
        "4",
        "2",
    )
    assert float(one["low"]) < 1 == float(one["high"])
    saved = next(
        r for r in rows if (r["row"], r["kind"], r["metric"]) == ("KARMA", "complex", "re")
    )
    assert (saved["value"], saved["published"]) == ("0.8", "0.867")
    unknown = next(r for r in rows if r["metric"] == "cost")
    assert (unknown["value"], unknown["low"]) == ("", "")


# ----------------------------------------------------------------- the paper's margins


def margins_of(tmp_path, **solved):
    """Return the margins of a run over ten composite tasks, from row -> tasks solved."""
    records = [
        plain(number < count, places=0 if row == "KARMA" else 10, row=row.replace("_", " "),
              task=f"t{number}", kind="composite")
        for row, count in solved.items() for number in range(10)
    ]  # fmt: skip
    run = read_run(write_run(tmp_path / "run", records))
    return {one.text: one for one in margins(result_of(run, PUBLISHED))}


def test_margins_take_the_best_baseline_and_no_twin_ablation_or_expert(tmp_path):
    found = margins_of(
        tmp_path, KARMA=9, HELPER=4, CAPEAM=6, KARMA_w_o=8, memory_off=8, expert=10
    )  # fmt: skip
    text = "SR of KARMA, composite tasks, times that of the best baseline"
    claim = found[text]
    assert (claim.rival, claim.ours.value, claim.wanted) == ("CAPEAM", 1.5, 1.3)
    assert claim.verdict == "yes, not surely"
    saved = found["RE of KARMA, composite tasks"]
    assert (saved.rival, saved.ours.value, saved.verdict) == (
        "memory off", pytest.approx(1.0), "yes",
    )  # fmt: skip
    assert found["RT of KARMA, composite tasks"].verdict == "no"  # ten steps each


def test_margins_that_fail_or_cannot_be_judged_are_said_to(tmp_path):
    text = "SR of KARMA, composite tasks, times that of the best baseline"
    assert margins_of(tmp_path / "a", KARMA=5, HELPER=5)[text].verdict == "no"
    assert margins_of(tmp_path / "b", KARMA=5, HELPER=0)[text].verdict == "undefined"
    assert margins_of(tmp_path / "c", KARMA=6, HELPER=5)[text].verdict == "no, not surely"
    assert margins_of(tmp_path / "d", KARMA=6) == {}


# ----------------------------------------------------------------- the published figures


def test_published_figures_are_those_of_the_paper(shared):
    """Every row of Tables 1 and 2 in the paper's text, cell by cell; "-" is no figure."""
    text = (shared / "paper" / "karma.txt").read_text()
    names = {name.replace(" ", ""): row for row, name in _paper_rows().items()}
    seen = set()
    for line in text.splitlines():
        name, *cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        name = re.sub(r"\(\w+ et al\., \w+\)", "", name).replace(" ", "")
        if name not in names or len(cells) != 12:
            continue
        for number, cell in enumerate(cells):
            kind, column = (
                ("simple", "composite", "complex")[number // 4],
                PUBLISHED_COLUMNS[number % 4],
            )
            found = PUBLISHED.get((names[name], kind, column))
            assert (found if found is not None else "-") == (float(cell) if cell != "-" else "-")
            if found is not None:
                seen.add((names[name], kind, column))
    assert seen == set(PUBLISHED)


def _paper_rows():
    with (PAPER / "published.csv").open() as lines:
        return {line["row"]: line["paper_row"] for line in csv.DictReader(lines)}


@pytest.mark.parametrize("path", sorted(PAPER.glob("table*.toml")), ids=lambda path: path.stem)
def test_experiments_of_the_tables_have_the_published_rows_and_five_seeds(path):
    experiment = read_experiment(path)
    names = [row.name for row in experiment.rows]
    assert experiment.seeds == (0, 1, 2, 3, 4)
    source = "Table 1" if path.stem.startswith("table1") else "Table 2"
    with (PAPER / "published.csv").open() as lines:
        published = {line["row"] for line in csv.DictReader(lines) if line["source"] == source}
    assert published <= set(names)
    assert "memory off" in names


# ----------------------------------------------------------------- the command


def test_table_command_writes_its_files(run, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    out = tmp_path / "out"
    arguments = ["table", str(run.folder)]
    said = karma(*arguments, "--out", out, "--json", out / "x.json")
    assert "table_1: simple tasks" in said
    unfinished = f"not finished, the figures are of the {len(run.records)} episodes that are done"
    assert unfinished in " ".join(said.split())
    assert sorted(path.name for path in out.iterdir()) == [
        "table.csv", "table.md", "x.json",
    ]  # fmt: skip
    result = result_of(run, PUBLISHED)
    assert (out / "table.md").read_text().startswith(to_markdown(sheets(result)))
    (run.folder / RESULTS).write_text("[]")  # what a run writes last
    assert "not finished" not in karma(*arguments, "--out", out)


def test_only_several_kinds_of_task_have_a_line_over_all_kinds(result, tmp_path):
    assert "| KARMA | all |" in to_markdown(sheets(result))
    records = [
        plain(row == "KARMA", places=3, row=row, task=task, kind="complex", seed=0)
        for row in ("KARMA", "memory off")
        for task in ("t1", "t2")
    ]
    result = result_of(read_run(write_run(tmp_path / "one", records, name="table_1")), PUBLISHED)
    text = to_markdown(sheets(result))
    assert "| KARMA | complex |" in text
    assert "| KARMA | all |" not in text


def test_tables_name_the_tasks_that_nobody_is_judged_by(tmp_path):
    left_out = replace(plain(False, task="t9"), unjudged="the scene has no Book")
    run = read_run(write_run(tmp_path / "run", [plain(True), left_out], name="apart"))
    text = to_markdown(sheets(result_of(run, PUBLISHED)))
    (line,) = rows_of(text, "apart: tasks that nobody is judged by")
    assert line == [("task", "t9"), ("why", "the scene has no Book")]
    assert "1 episode a row (1 task" in text
