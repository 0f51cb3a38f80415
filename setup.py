"""Puts the data folders `models/` and `eval/` into the wheel; all else stands in pyproject.toml.

They lie at the top of the checkout, where no package is, and go to `karma/shipped/`, where
`karma/files.py` finds them. Models are those of the manifest that the repository holds: never what
somebody brought (`models/weights/`), nor what only training reads.
"""

import tomllib
from collections.abc import Iterator
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


def shipped() -> Iterator[Path]:
    """Yield the files of both folders that belong into the wheel."""
    models = Path("models")
    manifest = models / "manifest.toml"
    if manifest.exists():
        yield from (manifest, models / "README.md", *sorted(models.glob("cards/*.md")))
        for model in tomllib.loads(manifest.read_text(encoding="utf-8"))["models"]:
            named = [models / file["path"] for file in model["files"]]
            own = [file for file in named if "weights" not in file.parts]
            yield from (own if "package" not in model else ())
    for path in sorted(Path("eval").rglob("*")):
        if path.is_file() and "results" not in path.parts:
            yield path


class BuildWithData(build_py):
    """Builds the package and lays the data beside it; an editable one uses the checkout's."""

    def run(self) -> None:
        """Build."""
        super().run()
        for path in () if self.editable_mode else shipped():
            target = Path(self.build_lib, "karma", "shipped", path)
            self.mkpath(str(target.parent))
            self.copy_file(str(path), str(target))


setup(cmdclass={"build_py": BuildWithData})
