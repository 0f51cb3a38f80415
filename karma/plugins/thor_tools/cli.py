"""`karma world import`, `floors` and `replay-events`: what AI2-THOR recorded."""

from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from karma.cli.parameters import option
from karma.cli.progress import track
from karma.cli.shared import Json, console, tell, write_json
from karma.files import below, to_json, write_atomic
from karma.journal.formats import figure_text

Files = Annotated[list[Path], typer.Argument(help="Files, also gzipped.")]
Layouts = Annotated[Path | None, typer.Option(help="ALFRED's reachable cells.")]
Assets = Annotated[Path | None, typer.Option(help="Boxes of ProcTHOR's assets, for houses.")]
Only = Annotated[list[str] | None, typer.Option(help="Names to take, such as FloorPlan1.")]


def world_import(
    files: Files,
    out: Path = option(Path("runs/scenes"), "Folder for the scene files."),
    layouts: Layouts = None,
    assets: Assets = None,
    only: Only = None,
    json: Json = None,
) -> None:
    """Turn AI2-THOR metadata dumps into scene files.

    Cells are computed from the boxes unless --layouts is given. A file of ProcTHOR's houses is
    known by its keys; things have their type's usual size unless --assets is given.
    """
    rows = [row for path in files for row in _import_dump(path, layouts, assets, only, out)]
    console.print(escape(f"{len(rows)} scenes in {out}"))
    write_json(json, rows)


def _import_dump(
    dump: Path, layouts: Path | None, assets: Path | None, only: list[str] | None, out: Path
) -> list[dict[str, Any]]:
    from karma.plugins.thor_tools.importing.procthor import holds_houses, import_houses
    from karma.plugins.thor_tools.importing.scenes import import_dump

    rows = []
    if houses := holds_houses(dump):
        scenes = import_houses(dump, assets=assets, only=only)
    else:
        scenes = import_dump(dump, layouts=layouts, only=only)
    for scene in track(scenes, f"importing {dump.name}"):
        path = below(out, f"{scene.name}.json", source=dump)
        write_atomic(path, to_json(scene))
        row = {"scene": scene.name, "objects": len(scene.objects), "path": str(path)}
        rows.append({**row, "source": scene.source})
        if "cells added" in scene.source or (houses and "; " in scene.source):
            console.print(escape(f"{scene.name}: {scene.source.partition('; ')[2]}"))
    return rows


def world_replay_events(files: Files, layouts: Layouts = None, json: Json = None) -> None:
    """Replay sessions that AI2-THOR recorded, and compare.

    The last line is the count: recordings, compared flags, and the share that is equal.
    """
    from karma.plugins.thor_tools.recorded import replay_events, total_rate

    reports = [
        replay_events(path, layouts=layouts) for path in track(files, "replaying", len(files))
    ]
    table = Table("recording", "steps", "compared", "equal", "%", "visible %", "changed %")
    table.columns[0].overflow = "fold"
    for one in reports:
        table.add_row(
            escape(Path(one.path).name), str(one.steps), str(one.compared),
            str(one.equal), _percent(one.rate), _percent(one.seen.rate),
            _percent(one.changes.rate),
        )  # fmt: skip
        for gap in one.differences:
            what = f"step {gap.step} {gap.action}: {gap.object_id or 'agent'} {gap.field}"
            cause = f" ({gap.cause})" if gap.cause else ""
            said = f"{gap.ours!r}, AI2-THOR {gap.theirs!r}{cause}"
            tell(f"{Path(one.path).name} {what} is {said}")
    console.print(table)
    whole = (
        {"rate": one.rate, "causes": one.causes, **msgspec.to_builtins(one)} for one in reports
    )
    write_json(json, list(whole))
    flags = sum(one.compared for one in reports)
    tell(f"events {len(reports)}, flags {flags}, equal {_percent(total_rate(reports))} %")


def _percent(share: float | None) -> str:
    """Return a share in percent, rounded down, so that only all is 100."""
    return figure_text(None if share is None else int(share * 10_000) / 100)
