"""`karma world`: rooms to import, list and look at."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from karma.cli.shared import Json, clear_errors, console
from karma.files import to_json, write_atomic

app = typer.Typer(no_args_is_help=True, help="Rooms: import, list, draw.")


@app.command("list")
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


@app.command("show")
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


@app.command("import")
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
