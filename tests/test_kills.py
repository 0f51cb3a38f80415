"""A kept home and a memory of homes, killed at instants drawn by lot: what was told is there.

`KARMA_SAMPLE=100 pytest tests/test_kills.py` kills each a hundred times.
"""

import json
import random
import time
from hashlib import sha256

from support.abuse import SAMPLE
from support.abuse.faults import Child
from support.needs import need_models
from support.run_files import lines_in

from karma.assistant.agent import Agent
from karma.models.embed.minilm import MiniLm
from karma.plugins.homes.houses import build_home
from karma.plugins.homes.lived.body import HomeRobot
from karma.plugins.homes.lived.home_map import HomeMap
from karma.plugins.homes.memory import ageing
from karma.plugins.homes.memory.episodes import EpisodeLog
from karma.plugins.homes.memory.setting import MemorySetting
from karma.plugins.homes.memory.true_memory import LOG, TrueMemory
from karma.plugins.homes.residents import Household

KILLS = SAMPLE or 2
ERRANDS = (
    "put the apple in the fridge", "wash the mug", "where is the apple?",
    "the potato always goes in the fridge", "put it on the dining table", "open the microwave",
    "put the potato away", "close the microwave", "put the apple back where it was",
)  # fmt: skip
DAYS, EVERY_H, LOOKS = (
    7 if SAMPLE else 1,
    2.0,
    6,
)  # an instruction every two hours, a look at six places each


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


# ----------------------------------------------------------------- a memory of homes


def living(folder):
    scene = build_home(3, 3)
    home = HomeMap(scene)
    household = Household(scene, seed=3, people=2, disturbance=0.4)
    memory = TrueMemory(MemorySetting(embedder=MiniLm(), places=home.places, folder=folder))
    robot, places = HomeRobot(household, home, memory.take_in), list(home.places)
    for number in range(int(DAYS * 24 / EVERY_H)):
        robot.wait((number + 1) * EVERY_H * 3600.0)
        for turn in range(LOOKS):
            robot.look_at(places[(number * LOOKS + turn) % len(places)])
        memory.commit()
        yield number


def live(folder):
    list(parts(living, folder))


def digest(folder):
    """All that a log holds, read by a connection of its own; "" where it holds no episode."""
    if not (folder / LOG).exists():
        return ""
    log = EpisodeLog(folder / LOG, NoTexts(), {})
    rows = [repr(one) for one in log.episodes()]
    names = ("looked", "doubts", *ageing.PARTS, ageing.BY_THING, ageing.BY_TYPE)
    kept = [json.dumps(log.kept(n)) for n in names]
    log.close()
    return sha256("\n".join([*rows, *kept]).encode()).hexdigest() if rows else ""


class NoTexts:
    name, dimension = "none", 1

    def embed(self, texts):
        raise AssertionError(texts)


def test_memory_is_as_it_was_after_an_instruction_and_none_before_the_last_told(tmp_path):
    digests, whole_s = whole(living, tmp_path / "whole", digest)
    assert len(set(digests)) == len(digests)
    inside = 0
    for folder, told in killed(live, tmp_path, whole_s):
        assert digest(folder) in (digests[told - 1 :] if told else ["", *digests])
        inside += 0 < told < len(digests)
    print(f"{KILLS} kills, {inside} of them between the first and the last instruction")
