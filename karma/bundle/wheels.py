"""Collect the wheels of a bundle by pip, and read their licences."""

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from importlib.metadata import Distribution
from pathlib import Path

from karma.errors import FileError, KarmaError
from karma.files import cache

BUILT = ".karma-llama"  # set-up's note, in the virtual environment, about llama.cpp's wheel
EPOCH = "315532800"  # 1980-01-01, the first day that a zip can name
_LICENCE_NAMES = ("licenses/", "licen", "copying", "notice", "authors")
_SOURCES = ("karma", "pyproject.toml", "README.md", "LICENSE")


def collect(pins: Sequence[Path], own: Path, kept: Path, out: Path, *, download: bool) -> None:
    """Put our own wheel and what the pins and it need into `out`, chosen by pip for this machine.

    With `download` what is missing in `kept` is first fetched there from the index that pip is
    configured for, the one thing here that reaches out. What exists as source only is built.

    Raises:
        KarmaError: pip could not; names what is missing.
        FileError: a wheel is none.
    """
    known = ["--find-links", str(kept), "--find-links", str(kept_wheels())]
    wanted = [word for path in pins for word in ("-r", str(path))] + [str(own)]
    if download:
        kept.mkdir(parents=True, exist_ok=True)
        _pip([*known, "--wheel-dir", str(kept), *wanted, "pip"])
    if any(kept.glob("pip-*.whl")):  # then no ensurepip is needed on the other side
        wanted.append("pip")
    for wheel in sorted(kept.glob("*.whl")):
        if not zipfile.is_zipfile(wheel):
            raise FileError(wheel, "not a whole wheel", fix="remove it, then --download")
    fix = "`karma bundle build ... --download` where there is a package index"
    _pip(["--no-index", *known, "--wheel-dir", str(out), *wanted], fix=fix)


def licence(wheel: Path) -> tuple[str, dict[str, bytes]]:
    """Return a line of a package's name, version and licence, and its licence files by name."""
    (one,) = Distribution.discover(path=[str(wheel)])
    said = one.metadata
    classifiers = said.get_all("Classifier") or ()
    named = [line.split(" :: ")[-1] for line in classifiers if line.startswith("License ::")]
    keys = ("License-Expression", "License")
    given = next((str(said[key]).strip() for key in keys if key in said), "")
    short = given.split("\n")[0][:60] or "; ".join(named) or "not stated"
    texts = {}
    with zipfile.ZipFile(wheel) as file:
        for path in file.namelist():
            folder, _, inside = path.partition("/")
            if folder.endswith(".dist-info") and inside.lower().startswith(_LICENCE_NAMES):
                texts[inside.removeprefix("licenses/")] = file.read(path)
    texts = {name: text for name, text in texts.items() if name and not name.endswith("/")}
    return f"{one.name} {one.version}: {short}", texts


def own_wheel(project: Path, folder: Path) -> Path:
    """Build this package's wheel; equal sources give equal bytes.

    It is built from a copy, since setuptools leaves things in the sources and takes them up again.

    Raises:
        KarmaError: it cannot be built.
    """
    if not (project / "pyproject.toml").is_file():
        raise KarmaError(f"{project}: no checkout of the project, so no wheel can be made of it")
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        ignored = shutil.ignore_patterns("__pycache__", "*.pyc")
        for source in (project / name for name in _SOURCES):
            if source.is_dir():
                shutil.copytree(
                    source, copy / source.name, ignore=ignored, copy_function=shutil.copyfile
                )
            elif source.exists():
                shutil.copyfile(source, copy / source.name)
        for path in copy.rglob("*"):
            path.chmod(0o755 if path.is_dir() else 0o644)
        _pip(
            ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder), name],
            SOURCE_DATE_EPOCH=EPOCH,
        )
    (made,) = folder.glob("karma_offline-*.whl")
    return made


def kept_wheels() -> Path:
    """Return where scripts/setup.sh keeps the llama-cpp-python wheel that runs here.

    There is a folder per set of build options; without a note of set-up's, the one above them.
    """
    try:
        _, _, folder = (Path(sys.prefix) / BUILT).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return cache() / "wheels"
    return Path(folder)


def _pip(arguments: Sequence[str], *, fix: str = "see the lines above", **more: str) -> None:
    """Run `pip wheel`, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-I", "-m", "pip", "wheel", "--no-input", "--quiet", *arguments],
        env={**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", **more},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        tail = "\n".join((done.stderr or done.stdout).strip().splitlines()[-12:])
        raise KarmaError(
            f"pip wheel failed (exit code {done.returncode}):\n{tail}\n  To fix: {fix}"
        )
