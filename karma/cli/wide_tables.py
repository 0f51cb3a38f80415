"""Tables that are wider than the terminal, in parts that fit: names may wrap, no figure is cut."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

from rich.console import Console
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

_UNBOUNDED = 100_000  # columns


def parts_of(table: Table, console: Console) -> list[Table]:
    """Return a table that fits as it is, another as several, each with the first columns."""
    width = console.width
    wide = console.options.update(width=_UNBOUNDED)
    if not table.columns or Measurement.get(console, wide, table).maximum <= width:
        return [table]
    count = _labels(table.columns)
    labels, others = table.columns[:count], table.columns[count:]
    aside = 3  # of padding and border, each
    room = width - 1 - sum(_narrowest(one) + aside for one in labels)
    groups: list[list[Column]] = [[]]
    left = room
    for column in others:
        needed = _needed(column) + aside
        if needed > left and groups[-1]:
            groups.append([])
            left = room
        groups[-1].append(column)
        left -= needed
    return [
        _part(table, [*labels, *group], count, title=not number, caption=number == len(groups) - 1)
        for number, group in enumerate(groups)
    ]


def _part(
    table: Table, columns: Sequence[Column], labels: int, *, title: bool, caption: bool
) -> Table:
    part = copy(table)
    part.columns = [
        replace(
            column,
            _index=number,
            no_wrap=False,
            overflow="fold",
            width=_needed(column) if number >= labels and _is_figure(column) else None,
        )
        for number, column in enumerate(columns)
    ]
    part.title = table.title if title else None
    part.caption = table.caption if caption else None
    return part


def _labels(columns: Sequence[Column]) -> int:
    """Return how many columns in front say what a line is of."""
    figures = [number for number, column in enumerate(columns) if _is_figure(column)]
    return max(1, figures[0]) if figures else 1


def _is_figure(column: Column) -> bool:
    return column.justify == "right"


def _needed(column: Column) -> int:
    if not _is_figure(column):
        return _narrowest(column)
    lines = [line for cell in column._cells for line in _plain(cell).splitlines()]
    return max([*map(_width, lines), *map(_width, _plain(column.header).split()), 1])


def _narrowest(column: Column) -> int:
    words = [word for cell in (column.header, *column._cells) for word in _plain(cell).split()]
    return min(max([*map(_width, words), 1]), 24)


def _plain(cell: object) -> str:
    return Text.from_markup(cell).plain if isinstance(cell, str) else str(cell)


def _width(text: str) -> int:
    return Text(text).cell_len
