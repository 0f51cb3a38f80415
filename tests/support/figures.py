"""Figures that the documents say: the records that have them, and where on a page they stand."""

import csv
import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from support.documents import text_of
from support.paths import ROOT

RESULTS = ROOT / "eval/results"
NUMBER = re.compile(r"(?<![\w@.])[-+]?(?:\d+(?:,\d{3})*(?:\.\d+)*|\.\d+)")
_FIGURE = r"([-+]?[\d.,]*\d(?: \[[^\]\n]*\])?|–)"  # what a `{}` of a sentence stands for


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """What a record says, as a page is to write it, and which record below eval/results that is."""

    text: str
    record: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A paragraph, item, row or heading of a page; `context` introduces its list or table."""

    start: int
    text: str
    context: str


Claim = tuple[str, Sequence[Figure]]  # a sentence with `{}` for each figure, and the figures


def row(name: str, *cells: Sequence[Figure]) -> Claim:
    """Return a row of a table; a cell has its figures between slashes, or `–` where all are so."""
    told = [cell if any(f.text != "–" for f in cell) else cell[:1] for cell in cells]
    text = " | ".join("/".join("{}" for _ in cell) for cell in told)
    return f"\n| {name} | {text} |\n", [figure for cell in told for figure in cell]


def span(figures: Sequence[Figure]) -> list[Figure]:
    """Return the least and the greatest of some figures, without their intervals."""
    order = sorted(map(bare, figures), key=lambda figure: float(figure.text.split()[0]))
    return [order[0], order[-1]]


# ----------------------------------------------------------------- the paper's tables


@cache
def lines_of(table: str) -> dict[tuple[str, str, str], dict[str, str]]:
    """Return the lines of a table.csv, by row, kind of tasks and metric."""
    lines = csv.DictReader(text_of(RESULTS / f"paper/{table}/table.csv").splitlines())
    return {(line["row"], line["kind"], line["metric"]): line for line in lines}


def in_table(
    table: str, row: str, kind: str, metric: str, form: str = ".2f", field: str = "value"
) -> Figure:
    """Return a figure of a paper's table; `–` where it has none."""
    value = lines_of(table)[row, kind, metric][field]
    return Figure(text=format(float(value), form) if value else "–", record=f"paper/{table}")


# ----------------------------------------------------------------- tables in Markdown


@cache
def _tables(path: str) -> list[tuple[str, list[list[str]]]]:
    """Return the tables of a file: the last line of text above each, and its rows."""
    found: list[tuple[str, list[list[str]]]] = []
    title = ""
    for part in re.split(r"((?:^\|.*\n)+)", text_of(ROOT / path), flags=re.MULTILINE):
        lines = part.split("\n")
        if part.startswith("|"):
            rows = [[c.strip() for c in line.strip("| ").split(" | ")] for line in lines if line]
            found.append((title, rows))
        else:
            title = next((line for line in reversed(lines) if line.strip()), title)
    return found


def column_of(path: str, heading: str, column: str) -> dict[tuple[str, ...], str]:
    """Return a column of the first table with it, under a heading with these words, by its rows.

    Raises:
        KeyError: there is no such table or column.
    """
    for title, (head, _, *rows) in _tables(path):
        if heading in title and column in head:
            place = head.index(column)
            return {tuple(row): row[place] for row in rows}
    raise KeyError(f"{path}: no table under {heading!r} with a column {column!r}")


def cell(path: str, heading: str, row: tuple[str, ...], column: str) -> Figure:
    """Return the cell of the row that begins with these cells."""
    cells = column_of(path, heading, column)
    text = next(text for key, text in cells.items() if key[: len(row)] == row)
    return Figure(text=text, record=_record_of(path))


def bare(figure: Figure) -> Figure:
    """Return a figure without its interval."""
    return Figure(text=figure.text.partition(" [")[0], record=figure.record)


def _record_of(path: str) -> str:
    return path.removeprefix("eval/results/").removesuffix("/table.md")


# ----------------------------------------------------------------- what `karma eval --json` wrote


@cache
def _entries(name: str) -> Any:
    return json.loads(text_of(RESULTS / f"{name}.json"))


def in_json(name: str, row: str, metric: str, form: str = ".2f", kind: str = "all") -> Figure:
    """Return a figure of a row on a kind of tasks."""
    return Figure(
        text=format(_values(name, row, kind)[metric]["value"], form), record=f"{name}.json"
    )


def counted(name: str, row: str, metric: str = "success", kind: str = "all") -> Figure:
    """Return how many episodes that were."""
    value = _values(name, row, kind)[metric]
    return Figure(text=str(round(value["value"] * value["number"])), record=f"{name}.json")


def asked(name: str, row: str, metric: str = "success", kind: str = "all") -> Figure:
    """Return of how many that is counted."""
    return Figure(text=str(_values(name, row, kind)[metric]["number"]), record=f"{name}.json")


def with_interval(name: str, row: str, metric: str = "success", kind: str = "all") -> Figure:
    value = _values(name, row, kind)[metric]
    text = f"{value['value']:.2f} [{value['low']:.2f}, {value['high']:.2f}]"
    return Figure(text=text, record=f"{name}.json")


def _values(name: str, row: str, kind: str) -> dict[str, dict[str, float]]:
    return next(one["values"] for one in _entries(name) if (one["row"], one["kind"]) == (row, kind))


def digest(record: str) -> str:
    """Return the first digits of the SHA-256 of a file or folder below eval/results."""
    path = RESULTS / record
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


# ----------------------------------------------------------------- pages


def blocks_of(text: str) -> Iterator[Block]:
    """Yield the parts of a page: each row of a table is one, and so is each item of a list."""
    start, context, table = 0, "", ""
    for part in re.split(r"(?<=\n)(?=\* |\||#|!\[)|(?<=\n\n)", text):
        table = (table or part) if part.startswith("|") else ""
        within = part.startswith(("|", "* ", "!", " "))
        if not within:
            context = "" if part.startswith("#") else part
        yield Block(start=start, text=part, context=context + table if within else "")
        start += len(part)


def blanked(text: str) -> str:
    """Return a text with its code and the targets of its links blanked, of the same length."""
    return re.sub(r"`[^`\n]+`|\]\([^)\n]*\)", lambda match: " " * len(match[0]), text)


def line_at(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def pattern_of(sentence: str) -> re.Pattern[str]:
    """Return what finds a sentence, however its lines break; each `{}` is a figure."""
    parts = [r"\s+".join(map(re.escape, part.split(" "))) for part in sentence.split("{}")]
    return re.compile(_FIGURE.join(parts))


def same(said: str, held: str) -> bool:
    """Return whether two figures are the same numbers, or the same text where they have none."""
    numbers = [[float(n.replace(",", "")) for n in NUMBER.findall(one)] for one in (said, held)]
    return numbers[0] == numbers[1] and (bool(numbers[0]) or said == held)
