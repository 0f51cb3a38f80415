"""Kill a robot's memory at random instants of a week, and see what a restart finds.

A child process lives through a week in a home and commits its memory after every instruction. It is
killed (SIGKILL) at a random instant. What the next process reads must be, to the last row, what the
memory was after some instruction, and no earlier one than the last that the child told of.

    python scripts/check_lived_kills.py --kills 50
"""

import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from karma.contracts import Vectors
from karma.infer.embed.minilm import MiniLm
from karma.memory.lived import ageing, likely
from karma.memory.lived.episodes import EpisodeLog
from karma.memory.lived.setting import MemorySetting
from karma.memory.lived.true_memory import LOG, TrueMemory
from karma.methods.lived.body import HomeRobot
from karma.methods.lived.home_map import HomeMap
from karma.world.houses import build_home
from karma.world.residents import Household

HOURS, PLACES = 2.0, 6  # an instruction every two hours, a look at six places each
DAYS, SEED = 7, 3
START_S = 1.0  # that a child takes to begin, about


def lived_week(folder: Path) -> Iterator[int]:
    """Live a week, with a memory in a folder; yield the number of each finished instruction."""
    scene = build_home(3, SEED)
    home = HomeMap(scene)
    household = Household(scene, seed=SEED, people=2, disturbance=0.4)
    memory = TrueMemory(MemorySetting(embedder=MiniLm(), places=home.places, folder=folder))
    robot = HomeRobot(household, home, memory.take_in)
    places = list(home.places)
    for number in range(int(DAYS * 24 / HOURS)):
        robot.wait((number + 1) * HOURS * 3600.0)
        for turn in range(PLACES):
            robot.look_at(places[(number * PLACES + turn) % len(places)])
        memory.commit()
        yield number


def digest(folder: Path) -> str:
    """Return the SHA-256 of all that a log holds, read by a connection of its own."""
    log = EpisodeLog(folder / LOG, _NoTexts(), {})
    rows = [repr(one) for one in log.episodes()]
    parts = ("looked", "doubts", *ageing.PARTS, *likely.PARTS)
    kept = [json.dumps(log.kept(name)) for name in parts]
    log.close()
    return sha256("\n".join([*rows, *kept]).encode()).hexdigest()


def main(
    kills: Annotated[int, typer.Option(help="How often the process is killed.")] = 50,
    seed: Annotated[int, typer.Option(help="Of the instants.")] = 0,
    child: Annotated[Path | None, typer.Option(hidden=True)] = None,
) -> None:
    """Kill a memory at random instants; exit code 1 if a restart finds anything else."""
    if child is not None:
        for number in lived_week(child):
            print(number, flush=True)
        return
    with tempfile.TemporaryDirectory() as place:
        whole_folder = Path(place, "whole")
        whole_folder.mkdir()
        begun = time.perf_counter()
        whole = [digest(whole_folder) for _ in lived_week(whole_folder)]
        week_s = time.perf_counter() - begun
        rng, wrong, inside = random.Random(seed), 0, 0
        for number in track(range(kills), description="kills"):
            folder = Path(place, str(number))
            folder.mkdir()
            last = killed(folder, START_S + rng.uniform(0.0, week_s))
            found = digest(folder) if (folder / LOG).exists() else ""
            wrong += not (found in whole[max(last, 0) :] or (last < 0 and _is_bare(folder)))
            inside += 0 <= last < len(whole) - 1
    print(
        f"{kills - wrong} of {kills} restarts found the log as it was after a finished "
        f"instruction; {inside} kills fell between the first and the last of {len(whole)}"
    )
    raise typer.Exit(1 if wrong else 0)


def killed(folder: Path, after_s: float) -> int:
    """Start a week in a process of its own and kill it; return its last finished instruction."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--child", str(folder)], stdout=subprocess.PIPE, text=True
    )
    time.sleep(after_s)
    process.send_signal(signal.SIGKILL)
    told, _ = process.communicate()
    lines = [line for line in told.split("\n")[:-1] if line]
    return int(lines[-1]) if lines else -1


def _is_bare(folder: Path) -> bool:
    """Return whether a log holds nothing: it was killed before its first instruction ended."""
    if not (folder / LOG).exists():
        return True
    log = EpisodeLog(folder / LOG, _NoTexts(), {})
    empty = len(log) == 0
    log.close()
    return empty


class _NoTexts:
    """An embedder for readers that look nothing up."""

    name, dimension = "none", 1

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Refuse: nothing is to be embedded."""
        raise AssertionError(texts)


if __name__ == "__main__":
    typer.run(main)
