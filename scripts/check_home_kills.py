"""Kill a conversation at random instants, and see what its home has kept.

A child process carries out errands in a kept home and tells of each when it is done. It is killed
(SIGKILL) at an instant drawn by lot. Whatever it told of must be in the home; what is there must be
the log of a process that nobody killed, as far as it goes; and the next process must open it, make
the room again as it was left, and go on.

    python scripts/check_home_kills.py --kills 100
"""

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from karma.talk.agent import Agent

ERRANDS = (
    "put the apple in the fridge",
    "wash the mug",
    "where is the apple?",
    "the potato always goes in the fridge",
    "put it on the dining table",
    "open the microwave",
    "put the potato away",
    "close the microwave",
    "put the apple back where it was",
)
SCENE, PLANNER = "kitchen_1", "karma-nano"
START_S = 1.0  # that a child takes at least to begin


def told(folder: Path) -> Iterator[int]:
    """Carry out all errands in a home; yields how many errands it holds after each."""
    home = folder / "home"
    agent = Agent(SCENE, planner=PLANNER, folder=folder / "talk", home=home)
    for errand in ERRANDS:
        agent.do(errand)
        yield len(agent.home.past)


def main(
    kills: Annotated[int, typer.Option(help="How often the process is killed.")] = 100,
    seed: Annotated[int, typer.Option(help="Of the instants.")] = 0,
    child: Annotated[Path | None, typer.Option(hidden=True)] = None,
) -> None:
    """Kill conversations at random instants; exit code 1 if a home keeps anything else."""
    if child is not None:
        for count in told(child):
            print(count, flush=True)
        return
    with tempfile.TemporaryDirectory() as place:
        begun = time.perf_counter()
        undisturbed = Path(place, "whole")
        undisturbed.mkdir()
        run(undisturbed, None)
        whole_s = time.perf_counter() - begun
        whole = log(undisturbed)
        rng, wrong, inside = random.Random(seed), list[str](), 0
        for number in track(range(kills), description="kills"):
            folder = Path(place, str(number))
            folder.mkdir()
            last = run(folder, START_S + rng.uniform(0.0, whole_s - START_S))
            inside += 0 < last < len(whole)
            if why := fault(folder, last, whole):
                wrong.append(f"kill {number}, after {last} were told: {why}")
    print("\n".join(wrong))
    print(
        f"{kills - len(wrong)} of {kills} homes were opened as they were left, with all that was "
        f"told; {inside} kills fell between the first and the last of {len(whole)} errands"
    )
    raise typer.Exit(1 if wrong else 0)


def run(folder: Path, after_s: float | None) -> int:
    """Start a conversation in a process of its own and kill it; returns what it told of last."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--child", str(folder)], stdout=subprocess.PIPE, text=True
    )
    if after_s is not None:
        time.sleep(after_s)
        process.send_signal(signal.SIGKILL)
    said, _ = process.communicate()
    lines = [line for line in said.split("\n")[:-1] if line]
    return int(lines[-1]) if lines else 0


def log(folder: Path) -> list[bytes]:
    """Return the lines of a home's log that are whole."""
    path = folder / "home/log.jsonl"
    return path.read_bytes().split(b"\n")[:-1] if path.exists() else []


def fault(folder: Path, last: int, whole: list[bytes]) -> str:
    """Return what is wrong with a home after a kill, "" where nothing is."""
    kept = log(folder)
    if kept != whole[: len(kept)]:
        return f"its log of {len(kept)} lines is not that of an undisturbed process"
    if len(kept) < last:
        return f"it kept {len(kept)} errands"
    try:  # the room is made again and held against the last errand's digest
        agent = Agent(SCENE, planner=PLANNER, folder=folder / "again", home=folder / "home")
    except Exception as error:  # noqa: BLE001 whatever it is, it is told
        return f"{type(error).__name__}: {error}"
    if len(agent.home.past) != len(kept):
        return f"{len(agent.home.past)} errands were read of {len(kept)}"
    before = len(agent.home.past)
    agent.do("turn on the faucet")
    return "" if len(agent.home.past) == before + 1 else "it does not go on"


if __name__ == "__main__":
    typer.run(main)
