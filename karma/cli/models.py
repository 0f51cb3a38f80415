"""`karma models`: what the manifest lists, and whether the files are right."""

import typer
from rich.table import Table

from karma.cli.shared import Json, clear_errors, console
from karma.files import to_json, write_atomic

app = typer.Typer(no_args_is_help=True, help="Models of models/manifest.toml.")


@app.command("list")
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


@app.command("verify")
@clear_errors
def models_verify() -> None:
    """Check size and SHA-256 of every model's files."""
    from karma.infer.manifest import read_manifest, verify

    for entry in read_manifest().models:
        verify(entry)
        console.print(f"[green]✓[/] {entry.name}: {len(entry.files)} files as they must be")
