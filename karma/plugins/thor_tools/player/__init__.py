"""Put the embedded world behind AI2-THOR's own process protocol: the genuine client drives it.

`ai2thor.controller.Controller(local_executable_path=command())` starts it; see `command`.
"""

import shlex
from collections.abc import Iterable
from pathlib import Path

from karma.offline.children import child_command


def command(scenes: str | Path | Iterable[str | Path] | None = None) -> str:
    """Return the text for `Controller(local_executable_path=...)`.

    Args:
        scenes: one folder, or several, of scene files to serve besides our own.

    >>> command("my rooms").endswith("my rooms'")
    True
    """
    folders = [scenes] if isinstance(scenes, str | Path) else scenes or ()
    words = child_command("karma.plugins.thor_tools.player.main:serve")
    for folder in folders:
        words += ["--scenes", str(Path(folder).resolve())]
    return shlex.join(words)
