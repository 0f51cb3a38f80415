"""What a Python child of ours runs first: nothing of the folder that it stands in, then the guard.

`children` starts it as a file with `-E -P`, and has a forkserver import it before all else.
"""

import os
import sys
from importlib import import_module
from pathlib import Path


def _find_ours() -> None:
    """Take this package from where it lies, and others from where the parent does."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    import_module("karma")  # its parts are found by it from now on
    del sys.path[0]
    sys.path += filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))


if __name__ == "__main__":
    _find_ours()
offline = import_module("karma.offline.guard")
offline.go_offline(allow_network=os.environ.get(offline.OFFLINE) != "1")  # as its parent
if __name__ == "__main__":
    _module, _, _name = sys.argv[1].partition(":")
    sys.exit(getattr(import_module(_module), _name)(*sys.argv[2:]))
