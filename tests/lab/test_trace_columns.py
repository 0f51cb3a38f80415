"""Cache traces with columns, and traces in which nothing comes again."""

import pytest
from typer.testing import CliRunner

from karma.cli import app
from karma.errors import FileError
from karma.lab.trace import comes_again, read_traces

ROWS = [("1", "a", "512", "get"), ("2", "b", "64", "get"), ("3", "a", "512", "set"),
        ("4", "c", "9", "get"), ("5", "a", "512", "get")]  # fmt: skip
HEAD = ("timestamp", "key", "size", "op")


def written(path, mark, *, head):
    path.write_text("".join(mark.join(row) + "\n" for row in ([HEAD] if head else []) + ROWS))
    return path


@pytest.mark.parametrize("mark", [",", "\t", ";", " "])
@pytest.mark.parametrize(("head", "column"), [(True, "key"), (False, "2")])
def test_column_is_read_by_name_or_number(tmp_path, mark, head, column):
    path = written(tmp_path / "trace.csv", mark, head=head)
    (trace,) = read_traces(path, column)
    assert [key for task in trace.named() for key in task] == ["a", "b", "a", "c", "a"]
    assert comes_again([trace])
    (whole,) = read_traces(path)
    assert not comes_again([whole])


@pytest.mark.parametrize(
    ("column", "said"), [("kye", "no column 'kye'.*key"), ("9", "4 columns"), ("0", "4 columns")]
)
def test_column_that_is_not_there_is_named(tmp_path, column, said):
    path = written(tmp_path / "trace.csv", ",", head=True)
    with pytest.raises(FileError, match=said):
        read_traces(path, column)


def test_command_says_that_no_key_comes_twice_and_what_helps(tmp_path):
    path = written(tmp_path / "trace.csv", ",", head=True)
    words = ["trace", str(path), "--policies", "lru[2]"]
    assert "no key comes twice" in CliRunner().invoke(app, words).output
    shown = CliRunner().invoke(app, [*words, "--column", "key"])
    assert shown.exit_code == 0
    assert "no key comes twice" not in shown.output
