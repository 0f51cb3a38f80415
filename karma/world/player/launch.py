"""Return what AI2-THOR's Controller needs in order to start the player."""

import shlex
from collections.abc import Iterable
from pathlib import Path

from karma.children import child_command


def command(scenes: str | Path | Iterable[str | Path] | None = None) -> str:
    """Return the text for `Controller(local_executable_path=...)`.

    Args:
        scenes: one folder, or several, of scene files to serve besides our own.

    >>> command("my rooms").endswith("my rooms'")
    True
    """
    if scenes is None:
        folders: list[str | Path] = []
    elif isinstance(scenes, str | Path):
        folders = [scenes]
    else:
        folders = list(scenes)
    words = child_command("karma.world.player.main:serve")
    for folder in folders:
        words += ["--scenes", str(Path(folder).resolve())]
    return shlex.join(words)
