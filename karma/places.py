"""Where the data lies that ships with the package, and which command mends an installation.

A checkout has `models/` and `eval/` at its top; a wheel carries copies of them in `karma/shipped/`,
put there when it is built (setup.py). A folder that the user names goes before both.
"""

import os
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from karma.errors import FileError, did_you_mean

PACKAGE = Path(__file__).parent
_PARENT = PACKAGE.parent


def is_checkout() -> bool:
    """Return whether this is the project's own folder and not an installed wheel."""
    return (_PARENT / "pyproject.toml").is_file() and (_PARENT / "setup.py").is_file()


def shipped(name: Literal["models", "eval"]) -> Path:
    """Return a folder of data: the checkout's, else the copy that the wheel carries."""
    return _PARENT / name if is_checkout() else PACKAGE / "shipped" / name


def cache() -> Path:
    """Return $KARMA_CACHE, by default ~/.cache/karma: what was computed or built once."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(os.environ.get("KARMA_CACHE") or f"{home}/karma")


def repair(in_checkout: str = "make setup") -> str:
    """Return the command that brings back what the package itself should have."""
    if is_checkout():
        return in_checkout
    return f"pip install --force-reinstall --no-deps karma-offline=={version('karma-offline')}"


def rebuild_llama(options: str) -> str:
    """Return the command that builds llama.cpp with CMake options; "" is our own."""
    if is_checkout():
        return f'make setup CMAKE_ARGS="{options}"' if options else "make setup CMAKE_ARGS="
    wanted = f"llama-cpp-python=={version('llama-cpp-python')}"
    build = f"pip install --force-reinstall --no-deps --no-binary :all: {wanted}"
    return f'CMAKE_ARGS="{options or "-DLLAVA_BUILD=ON"}" {build}'


def find_experiment(given: Path) -> Path:
    """Return an experiment's file: one that is there, else one that ships, by name or path.

    "demo", "demo.toml" and "eval/demo.toml" are the same from any folder; "table1" finds
    "paper/table1.toml".

    Raises:
        FileError: there is none; names the nearest that ships.
    """
    if given.is_file() or given.is_absolute():
        return given
    folder = shipped("eval")
    known = {path.relative_to(folder).with_suffix("").as_posix(): path
             for path in sorted(folder.rglob("*.toml")) if "results" not in path.parts}  # fmt: skip
    name = given.with_suffix("") if given.suffix == ".toml" else given
    wanted = name.as_posix().removeprefix("eval/")
    short = {key.rpartition("/")[2]: path for key, path in known.items()}
    if found := known.get(wanted) or short.get(wanted):
        return found
    hint = did_you_mean(wanted, [*known, *short]) or f" There is {', '.join(known)}"
    raise FileError(given, f"no such file, and no such experiment.{hint}", fix="karma eval demo")
