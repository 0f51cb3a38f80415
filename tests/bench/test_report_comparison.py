"""Pages that compare runs: the figures of `karma compare`, who solved what, links, and refusals."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from support.made_records import episode, sub, write_run
from support.run_files import karma

from karma.agent.journal.formats import figure_text
from karma.bench.figures.compare import compare_kinds
from karma.bench.figures.results import arms_named, sides_named
from karma.bench.report.comparison import (
    ComparisonPage,
    chosen_reference,
    comparison_of,
    render_comparison,
    sides_of,
)
from karma.errors import KarmaError

EVIL = "</script><img src=x onerror=alert(1)>"


def records(row, solved, *, count=8):
    goal = "OPEN(Fridge): 1"
    return [
        episode(
            sub(goal, unmet=() if number in solved else (goal,), instruction=EVIL),
            row=row, task=f"t{number}", kind="simple" if number < 4 else "complex",
        )
        for number in range(count)
    ]  # fmt: skip


@pytest.fixture
def runs(tmp_path):
    """Two runs of one row over the same eight tasks."""
    a = write_run(tmp_path / "a", records(EVIL, {0, 1, 2, 3, 4, 5, 6}), name="a")
    b = write_run(tmp_path / "javascript:b", records(EVIL, {0, 2}), name="b")
    return [str(a), str(b)]


def page_of(names, out, reference=""):
    sides, notes = sides_of(names)
    *shares, page = comparison_of("x", sides, chosen_reference(sides, reference), notes, out)
    assert shares == sorted(shares)
    assert isinstance(page, ComparisonPage)
    return page


def test_comparison_has_the_differences_that_karma_compare_has(runs, tmp_path):
    page = page_of(runs, tmp_path / "c.html")
    ((first, second),) = arms_named(sides_named(runs))
    for one in compare_kinds(second, first):
        found = page.against[page.sides[1], one.kind]
        assert found.p == figure_text(one.p_tasks, 3)
        assert found.pairs == one.pairs
        assert float(found.text.replace("−", "-")) == pytest.approx(
            one.success.difference.value, abs=0.0051
        )
    assert not any(side == page.reference for side, _ in page.against)


def test_comparison_is_against_the_reference_that_was_chosen(runs, tmp_path):
    page = page_of(runs, tmp_path / "c.html", runs[1])
    assert page.reference == runs[1]
    assert page.against[runs[0], "all"].text == "+0.62"
    with pytest.raises(KarmaError, match=r"none has that name\. Did you mean"):
        page_of(runs, tmp_path / "c.html", runs[1] + "x")


def test_comparison_shows_who_solved_which_task_and_leads_to_its_page(runs, tmp_path):
    page = page_of(runs, tmp_path / "c.html")
    solved = {line.task: [cell.successes for cell in line.cells] for line in page.tasks}
    assert solved["t0"] == [1, 1]
    assert solved["t1"] == [1, 0]
    assert solved["t7"] == [0, 0]
    text = render_comparison(page)
    places = re.findall(r'href="([^"]*)"', text)
    assert all(place.startswith(("#", "./")) for place in places)
    assert "./javascript%3Ab/report.html#task-t1" in places
    assert "<img" not in text
    assert "<script" not in text


def test_comparison_of_different_tasks_says_that_it_has_no_difference(tmp_path):
    a = write_run(tmp_path / "a", records("KARMA", {0}), name="a")
    b = write_run(tmp_path / "b", records("KARMA", {0}, count=3), name="b")
    page = page_of([str(a), str(b)], tmp_path / "c.html")
    assert page.against == {}
    assert any("no difference" in note and "different tasks" in note for note in page.notes)


def test_comparison_of_rows_of_one_run_names_them_by_the_run(tmp_path):
    both = [*records("KARMA", {0, 1}), *(replace(one, row="off") for one in records("x", {0}))]
    run = str(write_run(tmp_path / "a", both, name="a"))
    page = page_of([f"{run}:off", f"{run}:KARMA"], tmp_path / "c.html", "KARMA")
    assert page.sides == (f"{run}: off", f"{run}: KARMA")
    with pytest.raises(KarmaError, match="no row 'of'"):
        sides_of([f"{run}:of"])


def test_command_writes_the_comparison_and_the_pages_that_it_leads_to(runs, tmp_path):
    done = karma("report", *runs)
    assert "2 side by side, 8 tasks" in done
    page = (tmp_path / "comparison.html").read_text(encoding="utf-8")
    for place in {one.split("#")[0] for one in re.findall(r'href="(\./[^"]*)"', page)}:
        assert (tmp_path / Path(place.replace("%3A", ":"))).exists()
    assert "to step through" not in karma("report", *runs)  # they are new enough
