"""A kept home, killed at random instants: what was told is there.

`KARMA_SAMPLE=100 pytest tests/test_kills.py` kills each a hundred times.
"""

import random
import time

from support.abuse import SAMPLE
from support.abuse.faults import Child
from support.needs import need_models
from support.run_files import lines_in

from karma.assistant.agent import Agent

KILLS = SAMPLE or 2
ERRANDS = (
    "put the apple in the fridge", "wash the mug", "where is the apple?",
    "the potato always goes in the fridge", "put it on the dining table", "open the microwave",
    "put the potato away", "close the microwave", "put the apple back where it was",
)  # fmt: skip


def killed(work, folder, whole_s):
    """Kill processes of `work(folder)`; yields each folder and how many lines it had told."""
    rng = random.Random(0)
    for number in range(KILLS):
        place = folder / str(number)
        place.mkdir()
        Child(work, place).kill_after(rng.uniform(0.0, whole_s), lambda: True)
        yield place, lines_in(place / "told")


def whole(work, folder, kept):
    """Return what is kept after each part of an undisturbed process, and its seconds."""
    folder.mkdir()
    begun, found = time.monotonic(), []
    for _ in parts(work, folder):
        found.append(kept(folder))
    return found, time.monotonic() - begun


def parts(work, folder):
    """Do a work part by part, and tell of each on the disk when it is done."""
    with (folder / "told").open("w") as told:
        for number in work(folder):
            print(number, file=told, flush=True)
            yield number


# ----------------------------------------------------------------- a kept home


def talking(folder):
    agent = Agent("kitchen_1", planner="karma-nano", folder=folder / "talk", home=folder / "home")
    for number, errand in enumerate(ERRANDS):
        agent.do(errand)
        yield number


def talk(folder):
    list(parts(talking, folder))


def home_log(folder):
    path = folder / "home/log.jsonl"
    return path.read_bytes().split(b"\n")[:-1] if path.exists() else []


def test_home_is_opened_with_all_that_was_told_and_goes_on(tmp_path):
    need_models("karma-nano")
    logs, whole_s = whole(talking, tmp_path / "whole", home_log)
    inside = 0
    for folder, told in killed(talk, tmp_path, whole_s):
        kept = home_log(folder)
        assert kept == logs[-1][: len(kept)]
        assert len(kept) >= (len(logs[told - 1]) if told else 0)
        # the room is made again and held against the last errand's digest
        again = Agent(
            "kitchen_1", planner="karma-nano", folder=folder / "again", home=folder / "home"
        )
        assert len(again.home.past) == len(kept)
        again.do("turn on the faucet")
        assert len(again.home.past) == len(kept) + 1
        inside += 0 < told < len(ERRANDS)
    print(f"{KILLS} kills, {inside} of them between the first and the last errand")
