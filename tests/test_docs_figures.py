"""The figures of docs/results.md and README are those of the reference results."""

import csv
import re
from functools import cache

import pytest
from support.documents import text_of
from support.paths import ROOT

METRICS = {"success": "success", "RE": "re", "RE against memory off": "re", "RT, actions": "rt"}
KINDS = ("simple", "composite", "complex")


@cache
def reference(table: str) -> dict[tuple[str, str, str], dict[str, str]]:
    """Return the lines of a reference table, by row, kind and metric."""
    text = text_of(ROOT / f"eval/results/paper/{table}/table.csv")
    lines = csv.DictReader(text.splitlines())
    return {(line["row"], line["kind"], line["metric"]): line for line in lines}


def shown(heading: str) -> list[dict[str, tuple[str, str]]]:
    """Return the first table under a heading: per line (column, what it stands after) -> cell."""
    section = text_of(ROOT / "docs/results.md").partition(f"\n## {heading}\n")[2]
    rows = re.findall(r"^\| (.*) \|$", section.partition("\n\n* ")[0], re.MULTILINE)
    head, *lines = [[cell.strip() for cell in row.split(" | ")] for row in rows]
    width = len(head)
    return [
        dict(zip(zip(head, ["", *head[:-1]], strict=True), line, strict=True))
        for line in lines
        if len(line) == width and " / " in line[1]
    ]


def expected(tables: tuple[str, ...], row: str, metric: str, field: str) -> list[str]:
    """Return a row's figures by kind of task from the first table that has the row."""
    for table in tables:
        if (row, KINDS[0], metric) in reference(table):
            return [reference(table)[row, kind, metric][field] for kind in KINDS]
    raise AssertionError(f"no reference table has {row}")


@pytest.mark.parametrize(
    ("heading", "tables"),
    [
        ("The authors' tasks", ("table1_authors",)),
        ("Table 1, on our 48 tasks", ("table1", "table2")),
    ],
)
def test_table_on_the_results_page_has_the_figures_of_the_reference_results(heading, tables):
    lines = shown(heading)
    assert len(lines) >= 7
    for line in lines:
        row = line["row", ""]
        for (column, before), cell in line.items():
            published = column == "published"
            metric = METRICS.get(before if published else column)
            if metric is None:
                continue
            true = expected(tables, row, metric, "published" if published else "value")
            if cell == "–":
                assert not any(true), (row, column)
            else:
                said = [float(figure) for figure in cell.split(" / ")]
                assert said == [round(float(figure), 3 if published else 2) for figure in true], row


def test_front_page_says_of_karma_what_the_reference_results_say():
    text = text_of(ROOT / "README.md")
    for table, metric, kinds in (
        ("table1", "success", KINDS),
        ("table1_authors", "success", KINDS),
        ("table1", "re", KINDS[1:]),
        ("table1", "rt", KINDS[1:]),
    ):
        values = [reference(table)["KARMA", kind, metric]["value"] for kind in kinds]
        assert " / ".join(f"{float(value):.2f}" for value in values) in text
