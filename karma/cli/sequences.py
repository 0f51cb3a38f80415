"""`karma sequences`: tasks one after another in one home, which can be done in that order."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from karma.cli.shared import MATERIAL, clear_errors, console
from karma.errors import KarmaError
from karma.files import to_json, write_atomic

if TYPE_CHECKING:
    from karma.lab.sequences import Askable, DrawnSequence
    from karma.lab.workloads import Workload
    from karma.world.core.scene import Scene

ROOMS_FIX = "--scenes ../shared/data/thor5/scenes.jsonl.gz"


def add_to(app: typer.Typer) -> None:
    """Add the command to the top level."""
    app.command("sequences", rich_help_panel=MATERIAL)(sequences_command)


@clear_errors
def sequences_command(
    out: Annotated[Path, typer.Argument(help="The task file to write, *.jsonl.")],
    workload: Annotated[
        list[str] | None,
        typer.Option(help="type, house, rooms, habit or chain; can be given several times."),
    ] = None,
    length: Annotated[int, typer.Option(help="Tasks in each.", min=1)] = 25,
    number: Annotated[int, typer.Option(help="Sequences of each workload.", min=1)] = 8,
    seed: Annotated[int, typer.Option(help="Of what is drawn.", min=0)] = 0,
    tasks: Annotated[
        list[Path] | None, typer.Option(help="ALFRED's *.jsonl.gz; default: our task grammar.")
    ] = None,
    scenes: Annotated[
        Path | None, typer.Option(help="A dump of AI2-THOR's rooms for them: *.jsonl.gz.")
    ] = None,
    layouts: Annotated[Path | None, typer.Option(help="Reachable cells for those.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT.")] = False,
) -> None:
    """Draw a task file of long sequences in one home, done once by the expert.

    A task that is done already at its turn, or that the expert cannot do, is drawn anew.
    """
    from karma.lab.sequences import draw_sequence
    from karma.tasks.files import write_tasks

    wanted = _workloads(workload or ["house"])
    if out.suffix != ".jsonl":
        raise KarmaError(f"{out}: task files end in .jsonl\n  To fix: {out.with_suffix('.jsonl')}")
    if out.exists() and not force:
        raise KarmaError(f"{out} is there already\n  To fix: another name, or --force")
    with console.status("reading ..."):
        drawable = _askable(tasks or [], scenes, layouts, seed, out.parent / "scenes")
    drawn: list[DrawnSequence] = []
    with _bar() as bar:
        line = bar.add_task("drawing", total=len(wanted) * number * length)
        for kind in wanted:
            for index in range(number):
                step = partial(bar.advance, line)
                drawn.append(draw_sequence(drawable, kind, length, seed, index, step))
    used = {scene for one in drawn for scene in one.task.scenes}
    for scene in used:
        if scene.path:
            write_atomic(Path(scene.path), to_json(drawable.rooms[scene.name]))
    write_tasks(out, [one.task for one in drawn])
    about = out.with_suffix(".drawn.json")
    write_atomic(about, to_json(_about(drawable, drawn, length, seed), indent=2))
    _tell(drawable, drawn, length)
    console.print(escape(f"{len(drawn)} sequences: {out}; what was drawn: {about}"), soft_wrap=True)


def _workloads(names: Sequence[str]) -> "list[Workload]":
    from karma.lab.workloads import WORKLOADS

    if unknown := [name for name in names if name not in WORKLOADS]:
        raise KarmaError(f"no workload {unknown[0]!r}; there are {', '.join(WORKLOADS)}")
    return [one for one in WORKLOADS if one in names]


def _askable(
    tasks: Sequence[Path], scenes: Path | None, layouts: Path | None, seed: int, folder: Path
) -> "Askable":
    """Read the tasks and the rooms they play in."""
    from karma.lab.sequences import askable
    from karma.lab.tasks import alfred_pool, shipped_pool
    from karma.world.core.scene import load
    from karma.world.importing.scenes import import_dump

    if bool(tasks) != (scenes is not None):
        raise KarmaError(
            "--tasks and --scenes go together: ALFRED's tasks play in AI2-THOR's rooms\n"
            f"  To fix: add {ROOMS_FIX if tasks else '--tasks FILE'}, or leave both out"
        )
    if scenes is None:
        pool = shipped_pool(seed)
        return askable(pool, {e.scene: load(e.scene) for e in pool.errands})
    pool = alfred_pool(tasks)
    rooms: dict[str, Scene] = {room.name: room for room in import_dump(scenes, layouts=layouts)}
    return askable(pool, rooms, folder)


def _bar() -> Progress:
    return Progress(console=console, transient=True, disable=not console.is_terminal)


def _about(
    drawable: "Askable", drawn: "Sequence[DrawnSequence]", length: int, seed: int
) -> Mapping[str, object]:
    """Return what is written beside the task file."""
    return {
        "source": drawable.pool.source,
        "tasks_to_draw_from": len(drawable.pool.errands),
        "left_out": drawable.left_out,
        "length": length,
        "seed": seed,
        "sequences": [
            {
                "id": one.task.id,
                "rooms": len(one.task.scenes),
                "kinds": Counter(one.kinds),
                "drawn_anew": one.anew,
            }
            for one in drawn
        ],
    }


def _tell(drawable: "Askable", drawn: "Sequence[DrawnSequence]", length: int) -> None:
    """Print what was drawn, a row a workload, and which kinds of task."""
    reasons = sorted({reason for one in drawn for reason in one.anew})
    table = Table(title=escape(f"from {drawable.pool.source}"), title_justify="left")
    table.add_column("workload")
    for head in ("sequences", "tasks", "rooms", *(f"anew: {reason}" for reason in reasons)):
        table.add_column(head, justify="right")
    groups: dict[str, list[DrawnSequence]] = {}
    for one in drawn:
        groups.setdefault(one.workload, []).append(one)
    for workload, mine in groups.items():
        rooms = {scene for one in mine for scene in one.task.scenes}
        counts = (sum(one.anew.get(reason, 0) for one in mine) for reason in reasons)
        cells = (len(mine), len(mine) * length, len(rooms), *counts)
        table.add_row(workload, *map(str, cells))
    console.print(table)
    kinds = Counter(kind for one in drawn for kind in one.kinds).most_common()
    told = [("kinds of task", ", ".join(f"{kind} {count}" for kind, count in kinds))]
    told += [(f"left out, {reason}", str(n)) for reason, n in sorted(drawable.left_out.items())]
    for name, text in told:
        console.print(escape(f"{name}: {text}"), soft_wrap=True)
