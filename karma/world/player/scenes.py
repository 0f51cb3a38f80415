"""List the scenes that a player serves, under the names that AI2-THOR's client asks for."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from karma.errors import FileError
from karma.world.core.scene import SCENES
from karma.world.core.state import scene_name

VARIABLE = "KARMA_SCENES"  # folders of scene files, separated as in PATH


def folders(given: Sequence[str | Path], environment: Mapping[str, str]) -> list[Path]:
    """Return the folders of scene files: those given, else those of $KARMA_SCENES."""
    if given:
        return [Path(folder) for folder in given]
    value = environment.get(VARIABLE, "")
    return [Path(folder) for folder in value.split(os.pathsep) if folder]


def catalogue(more: Sequence[Path] = ()) -> dict[str, Path]:
    """Return name -> scene file: ours, then those in further folders, which may replace ours.

    A file's name is the scene's; the client itself appends `_physics` to `FloorPlan1`, so that is
    how such a scene is listed.

    Raises:
        FileError: a folder is missing or holds no scene file.
    """
    found: dict[str, Path] = {}
    for folder in (SCENES, *more):
        files = sorted(folder.glob("*.json"))
        if not files:
            reason = "holds no scene file (*.json)" if folder.is_dir() else "no such folder"
            raise FileError(folder, reason, fix=f"karma world import --out {folder}")
        found.update((scene_name(path.stem), path) for path in files)
    return found
