"""The AI2-THOR backend against a player that fails at every phase.

Covered: an error within 2 s (a start takes some more), no hang, no spinning core, nothing left
running, and an episode that can be started again. The one timing is the requirement itself. The
player is a scripted one (fake_player.py), the client AI2-THOR's own.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from support import fake_player

from karma.errors import KarmaError, WorldLost

pytest.importorskip("ai2thor", reason="needs the package ai2thor")

from karma.world.thor.backend import ThorWorld

WITHIN_S = 2.0
START_S = 5.0  # until a player is up, on a machine that has other things to do
STARTING = [
    "die@open", "segv@open", "die@first frame", "garbage@first frame", "huge@first frame",
    "half-die@first frame", "nonsense@first frame", "empty@first frame",
    "wrong-id@first frame", "die@GetScenesInBuild", "die@Reset", "segv@Reset", "garbage@Reset",
    "wrong-id@Reset", "die@Initialize", "close@Initialize", "wrong-id@Initialize",
]  # fmt: skip
STEPPING = [
    "die@MoveAhead", "segv@MoveAhead", "close@MoveAhead", "garbage@MoveAhead", "huge@MoveAhead",
    "half-die@MoveAhead", "nonsense@MoveAhead", "empty@MoveAhead",
    "wrong-id@MoveAhead",
]  # fmt: skip


class Spent:
    """What a call took: its error, seconds, and seconds of processor."""

    def __init__(self, call):
        self.error, cpu, start = None, time.process_time(), time.monotonic()
        thread = threading.Thread(target=self.run, args=(call,), daemon=True)
        thread.start()
        thread.join(20)
        assert not thread.is_alive(), "it hangs"
        self.wall_s = time.monotonic() - start
        self.cpu_s = time.process_time() - cpu

    def run(self, call):
        try:
            call()
        except Exception as error:  # noqa: BLE001
            self.error = error


def fails_in_time(call, within_s=WITHIN_S):
    spent = Spent(call)
    assert isinstance(spent.error, WorldLost), spent.error
    assert spent.wall_s < within_s
    assert spent.cpu_s < 0.5
    return spent.error


def alive(pid):
    """Return whether a process runs; a zombie does not."""
    stat = Path(f"/proc/{pid}/stat")
    with suppress(OSError):
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def gone(pid):
    limit = time.monotonic() + 5
    while alive(pid) and time.monotonic() < limit:
        time.sleep(0.01)
    return not alive(pid)


@pytest.fixture
def pid_file(tmp_path):
    return tmp_path / "pid"


@pytest.fixture
def world(tmp_path, pid_file):
    """Make worlds whose player has a fault in its first life only."""
    made = []

    def make(fault="", **limits):
        text = fake_player.command(fault, once=tmp_path / "once", pid=pid_file)
        made.append(ThorWorld(text, folder=tmp_path / "thor", **limits))
        return made[-1]

    yield make
    for one in made:
        one.stop()


def goes_on(world):
    """Start the episode again and do a step."""
    assert world.reset("FloorPlan1").metadata["sceneName"] == "FloorPlan1_physics"
    event = world.step("MoveAhead")
    assert event
    assert event is world.last_event
    assert event.metadata["lastAction"] == "MoveAhead"


@pytest.mark.parametrize("fault", STARTING)
def test_player_failing_at_start_is_an_error_in_time_and_can_be_started_again(
    fault, world, pid_file
):
    lost = world(fault)
    fails_in_time(lambda: lost.reset("FloorPlan1"), START_S + WITHIN_S)
    assert gone(int(pid_file.read_text()))
    goes_on(lost)


@pytest.mark.parametrize("fault", STEPPING)
def test_player_failing_in_a_step_is_an_error_in_time_and_can_be_started_again(
    fault, world, pid_file
):
    lost = world(fault)
    lost.reset("FloorPlan1")
    before = lost.last_event
    fails_in_time(lambda: lost.step("MoveAhead"))
    assert gone(int(pid_file.read_text()))
    assert lost.last_event is before
    goes_on(lost)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGTERM])
@pytest.mark.parametrize("whom", ["player", "client"])
def test_process_killed_between_steps_is_an_error_in_time(number, whom, world, pid_file):
    lost = world()
    goes_on(lost)
    player = int(pid_file.read_text())
    os.kill(player if whom == "player" else lost.pid, number)
    fails_in_time(lambda: lost.step("MoveAhead"))
    assert gone(player)
    assert "reset" in str(fails_in_time(lambda: lost.step("MoveAhead")))
    goes_on(lost)


@pytest.mark.parametrize("whom", ["player", "client"])
def test_reset_after_a_kill_between_steps_starts_afresh(whom, world, pid_file):
    lost = world()
    goes_on(lost)
    first = int(pid_file.read_text())
    os.kill(first if whom == "player" else lost.pid, signal.SIGKILL)
    goes_on(lost)
    assert int(pid_file.read_text()) != first


@pytest.mark.parametrize("whom", ["player", "client"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_process_killed_during_a_step_is_an_error_in_time(whom, number, world, pid_file):
    lost = world("hang@MoveAhead")
    lost.reset("FloorPlan1")
    player = int(pid_file.read_text())
    victim = player if whom == "player" else lost.pid
    killer = threading.Timer(0.3, os.kill, (victim, number))
    killer.start()
    fails_in_time(lambda: lost.step("MoveAhead"))
    assert gone(player)
    goes_on(lost)


def test_client_killed_before_the_first_frame_is_an_error_in_time(world, pid_file, tmp_path):
    lost = world("hang@open")
    children = Path(f"/proc/{os.getpid()}/task")

    def kill():
        while not pid_file.exists() or not pid_file.read_text():  # the player is up
            time.sleep(0.01)
        found = {p for t in children.iterdir() for p in (t / "children").read_text().split()}
        for pid in found:
            if b"thor.client" in Path(f"/proc/{pid}/cmdline").read_bytes():
                os.kill(int(pid), signal.SIGKILL)

    threading.Thread(target=kill, daemon=True).start()
    fails_in_time(lambda: lost.reset("FloorPlan1"), START_S + WITHIN_S)
    assert gone(int(pid_file.read_text()))
    goes_on(lost)


@pytest.mark.parametrize("fault", ["hang@open", "half@first frame", "hang@Reset"])
def test_player_hanging_at_start_is_an_error_after_the_time_limit(fault, world, pid_file):
    lost = world(fault, start_timeout_s=START_S)
    error = fails_in_time(lambda: lost.reset("FloorPlan1"), START_S + WITHIN_S)
    assert "in time" in str(error)
    assert gone(int(pid_file.read_text()))
    goes_on(lost)


@pytest.mark.parametrize("fault", ["hang@MoveAhead", "half@MoveAhead", "stopped"])
def test_player_hanging_in_a_step_is_an_error_after_the_time_limit(fault, world, pid_file):
    lost = world(fault, step_timeout_s=0.8)
    lost.reset("FloorPlan1")
    player = int(pid_file.read_text())
    if fault == "stopped":
        os.kill(player, signal.SIGSTOP)
    assert "in time" in str(fails_in_time(lambda: lost.step("MoveAhead"), 0.8 + WITHIN_S))
    assert gone(player)
    goes_on(lost)


def test_waiting_for_an_answer_spends_no_processor(world):
    def spent(pid):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    waiting = world("hang@MoveAhead", step_timeout_s=1.2)
    waiting.reset("FloorPlan1")
    seconds, guarding = [], waiting.pid
    timers = [threading.Timer(t, lambda: seconds.append(spent(guarding))) for t in (0.1, 1.0)]
    for timer in timers:
        timer.start()
    fails_in_time(lambda: waiting.step("MoveAhead"))
    assert seconds[1] - seconds[0] < 0.1


def test_error_tells_what_happened_during_what_and_where_the_output_is(world, tmp_path):
    lost = world("segv@MoveAhead")
    lost.reset("FloorPlan1")
    error = fails_in_time(lambda: lost.step("MoveAhead"))
    assert "SIGSEGV" in error.reason
    assert error.during == "MoveAhead"
    assert error.log == tmp_path / "thor" / "log" / "unity.log"
    assert "karma doctor thor" in str(error)


def test_stop_ends_player_and_its_children_and_can_be_repeated(tmp_path, pid_file):
    text = fake_player.command(pid=pid_file, child=tmp_path / "child")
    world = ThorWorld(text, folder=tmp_path / "thor")
    world.reset("FloorPlan1")
    world.stop()
    world.stop()
    assert gone(int(pid_file.read_text()))
    assert gone(int((tmp_path / "child").read_text()))
    with pytest.raises(KarmaError, match="reset"):
        world.step("MoveAhead")


SCRIPT = """
import os, sys
from karma.world.thor.backend import ThorWorld
ThorWorld(sys.argv[1], folder=sys.argv[2], scene="FloorPlan1")
os.kill(os.getpid(), int(sys.argv[3]))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_player_and_its_children_end_with_whoever_wanted_them(number, tmp_path, pid_file):
    child = tmp_path / "child"
    text = fake_player.command(pid=pid_file, child=child)
    words = [sys.executable, "-c", SCRIPT, text, str(tmp_path / "thor"), str(int(number))]
    subprocess.run(words, timeout=60, check=False)
    assert gone(int(pid_file.read_text()))
    assert gone(int(child.read_text()))
