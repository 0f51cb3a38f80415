"""`karma trace`: what replacement policies make of an access trace."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from karma.bench.formats import UNKNOWN, figure_text, percent_text
from karma.cli.shared import (
    PARTS,
    Json,
    clear_errors,
    console,
    write_json,
)
from karma.errors import KarmaError
from karma.files import write_atomic

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

    from karma.lab.intervals import Bootstrapped
    from karma.lab.sweep import Sweep
    from karma.lab.trace import Trace


def add_to(app: typer.Typer) -> None:
    """Add the command to the top level."""
    app.command("trace", rich_help_panel=PARTS)(trace_command)


@clear_errors
def trace_command(
    file: Annotated[
        Path | None,
        typer.Argument(help="Our *.json, a task file *.jsonl, LIRS *.trace.gz, a key a line."),
    ] = None,
    workload: Annotated[
        str, typer.Option(help="Instead of a file: type, house, rooms, habit or chain.")
    ] = "",
    unit_set: Annotated[str, typer.Option(help='"r4", or "m": what can be carried.')] = "r4",
    tasks: Annotated[
        list[Path] | None, typer.Option(help="ALFRED's *.jsonl.gz; default: our task grammar.")
    ] = None,
    sequences: Annotated[int, typer.Option(help="To draw.", min=1)] = 20,
    length: Annotated[int, typer.Option(help="Tasks in each.", min=1)] = 1000,
    policies: Annotated[
        str, typer.Option(help='Between ";", e.g. "lru; wtinylfu-karma[9,1] W=200"; default: all.')
    ] = "",
    sizes: Annotated[str, typer.Option(help="Units of policies without a size.")] = "5,10,25",
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
    column: Annotated[
        str, typer.Option(help="Of a FILE with columns: where the keys are, by name or number.")
    ] = "",
    json: Json = None,
    plot: Annotated[Path | None, typer.Option(help="Draw hit rates by size here.")] = None,
    save: Annotated[Path | None, typer.Option(help="Write the trace here, as our JSON.")] = None,
) -> None:
    """Try short-term memory's replacement policies on an access trace, beside the best possible."""
    from karma.lab.sweep import registered, run_rows, size_of, sized, sweep_of
    from karma.lab.trace import comes_again, read_traces, traces_json

    lines = _sizes(sizes)
    if policies:
        wanted = sized(policies.split(";"), lines)
        wanted = tuple(dict.fromkeys((*wanted, *_bounds(wanted))))
    else:
        wanted = registered(lines)
    with console.status("reading ..."):
        if (file is None) == (not workload):
            raise KarmaError("give a FILE or --workload: karma trace --workload type")
        if file is not None:
            traces, name = read_traces(file, column), str(file)
        else:
            traces, name = _drawn(workload, unit_set, tasks or [], sequences, length, seed)
    if not comes_again(traces):
        told = "no key comes twice in it, so no memory has a hit; of a file with columns: --column"
        console.print(told, style="yellow", soft_wrap=True)
    if save is not None:
        write_atomic(save, traces_json(traces))
    rows = []
    with _bar() as bar:
        line = bar.add_task("policies", total=len(wanted))
        for row in run_rows(traces, wanted, seed=seed):
            rows.append(row)
            bar.update(line, advance=1, description=row.policy)
        bar.update(line, description="policies")
    rows.sort(key=lambda row: (size_of(row.policy), -sum(row.hits)))
    found = sweep_of(traces, rows)
    console.print(_table(found, name))
    console.print(escape(_note(traces, found)), soft_wrap=True)
    if json is not None:
        write_json(json, {"trace": name, "sweep": found})
    if plot is not None:
        from karma.lab import plot as pictures

        picture = pictures.sizes(found, name, _note(traces, found))
        for path in pictures.save(picture, plot.with_suffix("")):
            console.print(escape(f"drawn: {path}"), soft_wrap=True)


def _sizes(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not all(part.isdecimal() and int(part) for part in parts):
        raise KarmaError(f"--sizes {text!r}: give numbers of units, e.g. --sizes 5,10,25")
    return [int(part) for part in parts]


def _bounds(policies: Sequence[str]) -> tuple[str, ...]:
    from karma.lab.simulate import BELADY
    from karma.lab.sweep import size_of

    return tuple(f"{BELADY}[{size}]" for size in sorted({size_of(text) for text in policies}))


def _drawn(
    workload: str, unit_set: str, tasks: list[Path], sequences: int, length: int, seed: int
) -> tuple[tuple["Trace", ...], str]:
    """Draw sequences; returns them with what they are called."""
    from karma.lab.tasks import UNIT_SETS, alfred_pool, grammar_pool
    from karma.lab.workloads import WORKLOADS, draw_errands, trace_of

    known = next((one for one in WORKLOADS if one == workload), None)
    units = next((one for one in UNIT_SETS if one == unit_set), None)
    if known is None:
        raise KarmaError(f"no workload {workload!r}; there are {', '.join(WORKLOADS)}")
    if units is None:
        raise KarmaError(f"no unit set {unit_set!r}; there are {', '.join(UNIT_SETS)}")
    pool = alfred_pool(tasks) if tasks else grammar_pool(seed)
    traces = tuple(
        trace_of(draw_errands(pool, known, length, seed, number), known, units)
        for number in range(sequences)
    )
    return traces, f"{known} {units}, {pool.source}"


def _bar() -> "Progress":
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
               TimeElapsedColumn())  # fmt: skip
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _table(found: "Sweep", name: str) -> "Table":
    from rich.box import HORIZONTALS
    from rich.table import Table

    from karma.lab.simulate import BELADY

    best = {row.size: row.cold for row in found.rows if row.policy.startswith(BELADY)}
    title = escape(f"hit rates: {name}")
    table = Table(title=title, title_justify="left", box=HORIZONTALS, padding=(0, 1, 0, 0))
    table.add_column("policy", no_wrap=True)
    for head in ("hits, %", "95 %", "of best", "first 100", "later half", "full after", "left"):
        table.add_column(head, justify="right", no_wrap=head == "95 %")
    size = found.rows[0].size if found.rows else 0
    for row in found.rows:
        if row.size != size:
            table.add_section()
            size = row.size
        bound = best.get(row.size)
        share = None
        if row.cold is not None and bound is not None and bound.value:
            share = row.cold.value / bound.value
        style = "dim" if row.policy.startswith((BELADY, "unbounded")) else ""
        table.add_row(
            escape(row.policy), percent_text(_value(row.cold), 2), _span(row.cold),
            figure_text(share), percent_text(_value(row.first), 2),
            percent_text(_value(row.steady), 2), figure_text(row.warm_task, 1),
            figure_text(row.left, 0), style=style,
        )  # fmt: skip
    return table


def _note(traces: Sequence["Trace"], found: "Sweep") -> str:
    tasks = sum(len(trace.tasks) for trace in traces)
    return (
        f"{len(traces)} sequence(s), {tasks} tasks, {sum(found.requests)} requests, "
        f"{found.units:.1f} distinct units a sequence; intervals: {found.interval}"
    )


def _span(rate: "Bootstrapped | None") -> str:
    if rate is None or rate.low is None or rate.high is None:
        return UNKNOWN
    return f"{percent_text(rate.low, 1)}–{percent_text(rate.high, 1)}"


def _value(rate: "Bootstrapped | None") -> float | None:
    return None if rate is None else rate.value
