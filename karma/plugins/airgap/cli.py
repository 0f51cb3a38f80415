"""`karma bundle`: everything in one archive, for a machine without a network."""

from dataclasses import asdict, dataclass
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer
from rich.markup import escape

from karma.cli.parameters import option
from karma.cli.shared import Json, console, tell, write_json

File = Annotated[Path, typer.Argument(help="The bundle.")]
Sha256 = Annotated[str, typer.Option(help="Of the bundle, as `build` said; refused otherwise.")]


@dataclass(frozen=True, kw_only=True)
class BuildCommand:
    """Write a bundle: wheels, models, scenes, experiments, licences."""

    out: Path = option(..., "The archive to write, e.g. karma.tar.")
    models: list[str] | None = option(None, "A model's name; default all that are here.")
    scenes: list[Path] | None = option(None, "Scene files or folders, beside our own.")
    wheels: Path | None = option(None, "Folder of wheels; default in ~/.cache/karma.")
    download: bool = option(False, "Fetch the wheels that are missing, by pip.", "--download")
    thor: Path | None = option(None, "Folder of an AI2-THOR build.")
    extras: bool = option(False, "With what hosted models and AI2-THOR need.", "--extras")
    lock: Path | None = option(None, "Other pins than requirements.lock.")
    json: Json = None

    def do(self) -> None:
        """Build it, and say what it holds."""
        from karma.files import cache
        from karma.plugins.airgap.build import PROJECT, BundleSpec, build

        begin, extras = monotonic(), self.extras or self.thor is not None
        spec = BundleSpec(
            wheels=self.wheels or cache() / "bundle-wheels",
            download=self.download,
            models=tuple(self.models or ()),
            scenes=tuple(self.scenes or ()),
            thor=self.thor,
            lock=self.lock or PROJECT / "requirements.lock",
            extras=PROJECT / "requirements-extras.lock" if extras else None,
        )
        with console.status("building the bundle ..."):
            built = build(self.out, spec, say=tell)
        names = escape(", ".join(built.models) or "none")
        console.print(
            f"[green]✓[/] {escape(str(built.path))}: {built.bytes / 1e6:.1f} MB, "
            f"{built.members} files, {built.wheels} wheels, models {names}; "
            f"{monotonic() - begin:.0f} s",
            soft_wrap=True,
        )
        console.print(f"SHA-256 {built.sha256}", soft_wrap=True)
        console.print("bring it by another way than the bundle, and give it as --sha256 over there")
        write_json(self.json, {**asdict(built), "path": str(built.path)})


def bundle_verify(file: File, sha256: Sha256 = "") -> None:
    """Check every file without unpacking; the first wrong one is named."""
    _installer(str(file), "--sha256", sha256)


def bundle_install(
    file: File,
    into: Path = option(..., "A new or empty folder."),
    sha256: Sha256 = "",
    smoke: bool = option(True, "Try it out afterwards."),
) -> None:
    """Verify and install, with no network; stopped, the same command does it again."""
    quick = () if smoke else ("--no-smoke",)
    _installer(str(file), "--into", str(into), "--sha256", sha256, *quick)


def _installer(*arguments: str) -> None:
    """Do what install.py out of the bundle does."""
    from karma.plugins.airgap.install import main

    raise typer.Exit(main(list(arguments)))
