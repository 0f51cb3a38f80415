"""The player and the client of a build, in a folder that means harm and under the guard."""

import os
import shlex
import subprocess
import sys

import pytest
from support.hostile_folder import KARMA, done_in, write_folder

from karma.offline.guard import OFFLINE
from karma.plugins.thor_tools.player import command

THOR = """from karma.offline.guard import OFFLINE
from karma.plugins.thor_tools.player import command
from karma.world.thor.backend import ThorWorld
world = ThorWorld(command())
world.reset("kitchen_1")
"""


def test_player_and_the_client_of_a_build_execute_nothing_of_the_folder(tmp_path):
    folder = write_folder(tmp_path)
    done_in(folder, *shlex.split(command()), "--scenes", "none", codes=(2,))
    pytest.importorskip("ai2thor", reason="needs the package ai2thor")
    home = {"HOME": str(folder.parent)}
    done_in(folder, sys.executable, "-P", "-c", THOR, **home)
    given = ("--executable", command(), "--start")
    done_in(folder, *KARMA, "doctor", "thor", *given, codes=(1,), **home)  # it asks for FloorPlan1


def test_player_is_guarded():
    program = "import karma.plugins.thor_tools.player.main as m, karma.offline.guard as o"
    program += "; m.main([]); print(o.is_armed())"
    clean = {name: value for name, value in os.environ.items() if name != OFFLINE}
    done = subprocess.run(
        [sys.executable, "-c", program], env=clean, capture_output=True, text=True, check=False
    )
    assert done.stdout == "True\n", done.stderr
