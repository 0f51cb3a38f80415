"""Measure the savings of short-term memory over sequences of requests, and its costs.

    python scripts/measure_short_term.py [--only 13 --only 117] [--lines] [--row memory]

Three requests in a row in a shipped room: objects are put somewhere, shut away, carried in a
vessel, refused, and requested again (`tests/support/errand_sequences.py`). Rows:

    memory      short-term memory and the map
    home        the same, kept on the disk and read again before each errand
    map only    the map alone: what the others are held against
    neither     no memory at all
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer
from measuring import table
from rich.progress import track
from support.errand_sequences import (
    ROWS,
    Cost,
    Drawn,
    cheaper,
    done,
    drawn,
    explained,
    given_planner,
)

from karma.offline.guard import go_offline

REFERENCE = "map only"
MAPS = Path("runs/maps-short")  # of the rooms as after the first visit
HEAD = "row | errands | right | places searched | steps | cheaper, same, dearer"
Rows = Mapping[str, Sequence[Cost]]


def told(sequence: Drawn, rows: Rows, *, lines: bool) -> Iterator[str]:
    """Yield the outcome of a sequence, with the lines of its programs if wanted."""
    texts = "; ".join(errand.text for errand in sequence.errands)
    yield f"{sequence.number} {sequence.scene}, {sequence.kind}: {texts}"
    for row, costs in rows.items():
        yield f"    {row}: " + "; ".join(f"{c.places} places, {c.steps} steps" for c in costs)
        for result in (result for cost in costs for result in cost.results if lines):
            why = "" if result.ok else f": {result.reason}"
            cost = f"{result.explorations} places, {result.actions} steps"
            yield f"        {result.call}, {cost}{why}"


def sums(found: Sequence[Rows]) -> Iterator[Sequence[object]]:
    """Yield the sums of each row."""
    for row in found[0]:
        costs = [cost for rows in found for cost in rows[row]]
        sides = Counter(cheaper(rows[row], rows[REFERENCE]) for rows in found)
        places, steps = sum(cost.places for cost in costs), sum(cost.steps for cost in costs)
        right = sum(cost.right for cost in costs)
        yield (
            row,
            len(costs),
            right,
            f"{places:,}",
            f"{steps:,}",
            ", ".join(str(sides[n]) for n in (1, 0, -1)),
        )


def main(
    sequences: int = 200,
    only: Annotated[list[int] | None, typer.Option(help="Numbers of sequences.")] = None,
    row: Annotated[list[str] | None, typer.Option(help=f"Beside {REFERENCE!r}.")] = None,
    lines: Annotated[bool, typer.Option(help="Print all that was done.")] = False,
) -> None:
    """Run all sequences in all rows; print savings and explained costs of memory."""
    go_offline()
    wanted = [name for name in ROWS if name == REFERENCE or name in (row or ROWS)]
    resources, found, unexplained = given_planner(MAPS), list[Rows](), 0
    for sequence in track([drawn(n) for n in only or range(sequences)], description="sequences"):
        rows = {name: done(sequence, name, resources) for name in wanted}
        found.append(rows)
        kept = [name for name in wanted if name in ("memory", "home")]
        dear = [name for name in kept if cheaper(rows[name], rows[REFERENCE]) < 0]
        if dear or lines:
            print("\n".join(told(sequence, rows, lines=lines)), flush=True)
        for name in dear:
            by_the_way = explained(rows[name], rows[REFERENCE])
            unexplained += not by_the_way
            print(f"    {name} is dearer{' by the way alone' if by_the_way else ''}", flush=True)
    table(HEAD, sums(found))
    print(f"{unexplained} dearer ones are not explained")


if __name__ == "__main__":
    typer.run(main)
