"""The `karma` command."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from karma import show
from karma.errors import KarmaError
from karma.files import to_json, write_atomic

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="A household agent that remembers, offline."
)
world_app = typer.Typer(no_args_is_help=True, help="Rooms: import, list, draw.")
models_app = typer.Typer(no_args_is_help=True, help="Models of models/manifest.toml.")
app.add_typer(world_app, name="world")
app.add_typer(models_app, name="models")
console = Console()

Json = Annotated[Path | None, typer.Option("--json", help="Also write the figures here.")]


def clear_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn the package's errors into a message and exit code 1; anything else is a bug."""

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except KarmaError as error:
            text = f"[red]error:[/] {escape(str(error))}"
            Console(stderr=True).print(text, highlight=False, soft_wrap=True)
            raise typer.Exit(1) from error

    return wrapped


@app.command("run")
@clear_errors
def run_command(
    instruction: Annotated[str, typer.Argument(help="What to do, in plain words.")],
    scene: Annotated[str, typer.Option(help="A scene's name or file.")] = "kitchen_1",
    planner: Annotated[str, typer.Option(help="Name in the manifest, or a GGUF.")] = "karma-nano",
    profile: Annotated[str, typer.Option(help='"compact" or "full".')] = "",
    chat: Annotated[bool, typer.Option(help="Use the GGUF's chat template.")] = False,
    long_term: Annotated[bool, typer.Option(help="With long-term memory.")] = True,
    short_term: Annotated[bool, typer.Option(help="With short-term memory.")] = True,
    policy: Annotated[str, typer.Option(help='e.g. "fifo-merge[10]".')] = "wtinylfu-karma[9,1]",
    recall: Annotated[str, typer.Option(help='"cosine" is the paper\'s.')] = "stateful",
    recall_k: Annotated[int, typer.Option("--k", help="Units in the prompt.")] = 3,
    maps: Annotated[Path, typer.Option(help="Folder of long-term memories.")] = Path("runs/maps"),
    seed: int = 0,
    json: Json = None,
) -> None:
    """Carry out an instruction while you watch; sub-tasks are split at commas and "then"."""
    from karma import registry
    from karma.bench.clauses import split_instruction
    from karma.bench.experiment import Models, make_kit
    from karma.bench.records import Call
    from karma.contracts import Outcome, SkillResult, SubTask
    from karma.methods.karma import KarmaMethod

    with console.status("loading models ..."):
        kit = make_kit(
            Models(planner=planner, profile=profile, chat=chat, recall=recall),
            maps=maps,
            seed=seed,
            learn=True,
        )
        options = {
            "long_term": long_term,
            "short_term": short_term,
            "policy": policy,
            "recall_k": recall_k,
            "query": "subtask",
        }
        method = KarmaMethod.build(kit, options)
        world = registry.load("worlds", "embedded")()
        world.reset(scene)
    with console.status(escape(f"getting to know {scene} ...")):
        method.begin(world, scene, seed=seed, folder=maps)
    if method.graph is not None:
        areas = method.graph.areas()
        console.print(
            f"long-term memory: {len(areas)} areas, {len(method.graph.objects())} objects"
        )
    lines = []
    finished = True
    for number, text in enumerate(split_instruction(instruction), start=1):
        view = show.InstructionView(number, text)
        calls: list[SkillResult] = []
        with Live(view, console=console, refresh_per_second=12) as live:
            for moment in method.do(SubTask(instruction=text, whole=instruction)):
                view.add(moment)
                live.update(view)
                if isinstance(moment, SkillResult):
                    calls.append(moment)
                elif isinstance(moment, Outcome):
                    finished = finished and moment.finished
        if not console.is_terminal:
            console.print()
        lines.append({"instruction": text, "calls": [Call.of(call) for call in calls]})
    console.print(show.memory_table(method.short_term.units(), "short-term memory now"))
    if json is not None:
        write_atomic(json, to_json({"finished": finished, "instructions": lines}, indent=2))
    if not finished:
        raise typer.Exit(2)


@app.command("eval")
@clear_errors
def eval_command(
    file: Annotated[Path, typer.Argument(help="An experiment, e.g. eval/demo.toml.")],
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/NAME.")] = None,
    fresh: Annotated[bool, typer.Option(help="Start over instead of going on.")] = False,
    tasks: Annotated[bool, typer.Option(help="Also print a line per task.")] = False,
    json: Json = None,
) -> None:
    """Run an experiment; what is done already is not done again."""
    from karma.bench.experiment import Run
    from karma.bench.records import summarise

    with console.status(escape(f"reading {file} ...")):
        run = Run(file, out or Path("runs") / file.stem, fresh=fresh)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )
    with bar:
        line = bar.add_task("episodes", total=run.total, completed=len(run.records))
        for record in run.episodes():
            mark = "[green]✓[/]" if record.success else "[red]✗[/]"
            bar.update(line, advance=1, description=f"{mark} {record.task} · {record.row}")
        bar.update(line, description="episodes")
    if tasks or run.experiment.authors:
        console.print(show.task_table(run.records))
    lines = summarise(run.records)
    console.print(show.summary_table(lines, run.experiment.name))
    console.print(escape(f"records: {run.records_path}"))
    write_atomic(run.folder / "results.json", to_json(lines, indent=2))
    if json is not None:
        write_atomic(json, to_json(lines, indent=2))


# ----------------------------------------------------------------- worlds


@world_app.command("list")
@clear_errors
def world_list(json: Json = None) -> None:
    """List the scenes that ship with the project."""
    from karma.world import scene

    table = Table("scene", "room", "objects", "cells", "source")
    rows = []
    for path in sorted(scene.SCENES.glob("*.json")):
        one = scene.load(path)
        rows.append((one.name, one.room, len(one.objects), len(one.reachable), one.source))
        table.add_row(*map(str, rows[-1]))
    console.print(table)
    if json is not None:
        names = ("scene", "room", "objects", "cells", "source")
        write_atomic(json, to_json([dict(zip(names, row, strict=True)) for row in rows], indent=2))


@world_app.command("show")
@clear_errors
def world_show(
    scene: Annotated[str, typer.Argument(help="A scene's name or file.")],
    out: Annotated[Path | None, typer.Option(help="PNG to write; default NAME.png.")] = None,
) -> None:
    """Draw a room from above."""
    from karma.world import scene as scenes
    from karma.world.draw import draw_top_down

    one = scenes.load(scene)
    path = out or Path(f"{one.name}.png")
    draw_top_down(one, path)
    console.print(escape(f"{path}: {one.name}, {one.room}, {len(one.objects)} objects"))


@world_app.command("import")
@clear_errors
def world_import(
    dump: Annotated[Path, typer.Argument(help="AI2-THOR metadata: one JSON line a room.")],
    out: Annotated[Path, typer.Option(help="Folder for the scene files.")] = Path("runs/scenes"),
    layouts: Annotated[Path | None, typer.Option(help="ALFRED's reachable cells.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="Names, e.g. FloorPlan1.")] = None,
    json: Json = None,
) -> None:
    """Turn an AI2-THOR metadata dump into scene files."""
    from karma.world.importers import import_dump

    rows = []
    with console.status(escape(f"importing {dump} ...")) as status:
        for scene in import_dump(dump, layouts=layouts, only=only):
            path = out / f"{scene.name}.json"
            write_atomic(path, to_json(scene))
            rows.append({"scene": scene.name, "objects": len(scene.objects), "path": str(path)})
            status.update(f"importing {scene.name} ...")
    console.print(escape(f"{len(rows)} scenes in {out}"))
    if json is not None:
        write_atomic(json, to_json(rows, indent=2))


# ----------------------------------------------------------------- models


@models_app.command("list")
@clear_errors
def models_list(json: Json = None) -> None:
    """List the models of the manifest."""
    from karma.infer.manifest import read_manifest

    table = Table("model", "role", "format", "MB", "licence")
    entries = read_manifest().models
    for entry in entries:
        size = sum(file.bytes for file in entry.files) / 1e6
        table.add_row(entry.name, entry.role, entry.format, f"{size:.1f}", entry.licence)
    console.print(table)
    if json is not None:
        write_atomic(json, to_json(entries, indent=2))


@models_app.command("verify")
@clear_errors
def models_verify() -> None:
    """Check size and SHA-256 of every model's files."""
    from karma.infer.manifest import read_manifest, verify

    for entry in read_manifest().models:
        verify(entry)
        console.print(f"[green]✓[/] {entry.name}: {len(entry.files)} files as they must be")
