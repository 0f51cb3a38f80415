"""The AI2-THOR backend with our own player in Unity's place, killed at every phase.

Covered: an error within 2 s, and the episode started again gives the same bytes. The one timing is
the requirement itself. Faults that only a broken player has are in test_thor_backend_faults.py.
"""

import json
import os
import signal
import struct
import threading
import time
from contextlib import suppress
from pathlib import Path

import msgpack
import pytest
from support.household import kitchen
from test_thor_backend_faults import START_S, WITHIN_S, Spent, alive, fails_in_time, gone

pytest.importorskip("ai2thor", reason="needs the package ai2thor")

from karma.errors import WorldLost
from karma.files import to_json
from karma.plugins.thor_tools.player import command
from karma.world.thor.backend import ThorWorld

DEADLY = [signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT]


def children(pid):
    """Return the process ids that a process of any thread has started."""
    found = []
    with suppress(OSError):  # it may end meanwhile
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
    return found


def player_of(client):
    """Return the player's process id, or None while there is none; it is no copy of the client."""
    for pid in children(client):
        with suppress(OSError):
            words = Path(f"/proc/{pid}/cmdline").read_bytes()
            if (
                b"karma.plugins.thor_tools.player.main:serve" in words
                and b"thor.client" not in words
            ):
                return pid
    return None


def coming_player():
    """Wait for the player that this process is about to start."""
    while True:
        for client in children(os.getpid()):
            if (pid := player_of(client)) is not None:
                return pid
        time.sleep(0.005)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "handmade.json").write_bytes(to_json(kitchen()))
    return folder


@pytest.fixture
def world(scenes, tmp_path):
    made = ThorWorld(command(scenes), folder=tmp_path, headless=True, step_timeout_s=10)
    yield made
    made.stop()


def episode(world):
    """Do the same few steps from the start; return what was seen."""
    world.reset("handmade")
    actions = ("MoveAhead", "RotateRight", "LookDown", "GetReachablePositions")
    return [json.dumps(world.step(action).metadata) for action in actions]


@pytest.mark.parametrize("number", DEADLY)
@pytest.mark.parametrize("wait_s", [0.0, 0.15])
def test_player_killed_before_its_pipe_opens_is_an_error_in_time(number, wait_s, world):
    killed = []

    def kill():
        killed.append(coming_player())
        time.sleep(wait_s)
        os.kill(killed[0], number)

    def start_and_go_on():
        world.reset("handmade")
        assert gone(killed[0])  # a fast machine: the player was up before it was killed
        world.step("MoveAhead")

    threading.Thread(target=kill, daemon=True).start()
    fails_in_time(start_and_go_on, START_S + WITHIN_S)
    assert not alive(killed[0])
    assert episode(world) == episode(world)


@pytest.mark.parametrize("number", DEADLY)
def test_player_killed_between_steps_is_an_error_in_time(number, world):
    seen = episode(world)
    player = player_of(world.pid)
    os.kill(player, number)
    fails_in_time(lambda: world.step("MoveAhead"))
    assert gone(player)
    assert episode(world) == seen


@pytest.mark.parametrize("number", DEADLY)
@pytest.mark.parametrize("during", ["step", "reset"])
def test_player_killed_in_the_middle_is_an_error_in_time(number, during, world):
    seen = episode(world)
    player = player_of(world.pid)
    os.kill(player, signal.SIGSTOP)  # holds it in the middle

    def kill():
        os.kill(player, number)
        with suppress(ProcessLookupError):  # it may be gone already
            os.kill(player, signal.SIGCONT)

    threading.Timer(0.3, kill).start()
    if during == "step":
        fails_in_time(lambda: world.step("MoveAhead"))
    else:  # a new episode does not mind that the last one's player dies
        spent = Spent(lambda: world.reset("handmade"))
        assert spent.error is None
    assert not alive(player)
    assert episode(world) == seen


def test_player_that_hangs_is_an_error_after_the_time_limit(scenes, tmp_path):
    world = ThorWorld(command(scenes), folder=tmp_path, headless=True, step_timeout_s=1)
    seen = episode(world)
    player = player_of(world.pid)
    os.kill(player, signal.SIGSTOP)
    spent = Spent(lambda: world.step("MoveAhead"))
    assert isinstance(spent.error, WorldLost)
    assert spent.wall_s < 1 + 2
    assert spent.cpu_s < 0.5
    assert gone(player)
    assert episode(world) == seen
    world.stop()


def message(sequence):
    body = msgpack.packb({"agents": [], "sequenceId": sequence})
    return struct.pack("!BI", 1, len(body)) + body + b"\xff\0\0\0\0"


@pytest.mark.parametrize(
    "data", [b"Segmentation fault\n", b"\x01\xff\xff\xff\xff too long", message(999)]
)
def test_nonsense_in_the_players_pipe_is_an_error_in_time(data, world):
    seen = episode(world)
    player = player_of(world.pid)
    words = Path(f"/proc/{player}/environ").read_text().split("\0")
    pipe = dict(word.split("=", 1) for word in words if word)["AI2THOR_FIFO_SERVER_PIPE_PATH"]
    os.kill(player, signal.SIGSTOP)
    with Path(pipe).open("wb") as file:
        file.write(data)
    fails_in_time(lambda: world.step("MoveAhead"))
    assert gone(player)
    assert episode(world) == seen


def test_many_deaths_leave_nothing_behind(world):
    before = len(children(os.getpid()))
    files = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    for _ in range(5):
        world.reset("handmade")
        os.kill(player_of(world.pid), signal.SIGKILL)
        with pytest.raises(WorldLost):
            world.step("MoveAhead")
    assert len(children(os.getpid())) == before
    assert len(os.listdir("/proc/self/fd")) <= files + 2  # noqa: PTH208
