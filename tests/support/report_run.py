"""A small real run: an agent whose model says what it was told, in the embedded world, on disk."""

import hashlib

import numpy as np

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.bench.engine.episode import run_episode
from karma.bench.figures.columns import added_up
from karma.bench.methods.expert import ExpertMethod
from karma.goals.goals import parse_goal
from karma.journal.folder import RESULTS
from karma.journal.header import Header
from karma.journal.run_folder import Finished, RunFolder
from karma.journal.steps import StepLog
from karma.journal.writer import TimeLog
from karma.memory.recall import CosineRecall
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

AGENT, EXPERT = "KARMA <b>&amp;", "expert"  # a row may be called anything
EVIL = "Fetch it </script><script>document.title = 'owned'</script><img src=x onerror=alert(1)>."
AWAY = (
    "Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n"
)
BACK = (
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\n"
    "CloseObject(robot, 'Fridge')\nExplore(robot, 'Mug')\n"  # which shows it more than it keeps
)
POURED = "</script><script>document.title = 'owned'</script>"  # no program
DISC = "Explore(robot, 'CD')\nGoToObject(robot, 'CD')\nPickupObject(robot, 'CD')\n"
MUG = "Explore(robot, 'Mug')\nGoToObject(robot, 'Mug')\n"
SEQUENCE_KEYS = ((AGENT, "s4", 0), (EXPERT, "s4", 0), (EXPERT, "s16", 0))
KEYS = ((AGENT, "t1", 0), (AGENT, "t2", 0), (EXPERT, "t1", 0), (EXPERT, "t1", 1))


class Words:
    """Texts as counts of their words: an embedder without weights."""

    name, dimension = "words", 64

    def embed(self, texts):
        rows = np.zeros((len(texts), self.dimension), dtype=np.float32)
        for row, text in zip(rows, texts, strict=True):
            for word in text.lower().split():
                row[hashlib.sha256(word.encode()).digest()[0] % self.dimension] += 1
            row /= np.linalg.norm(row) or 1
        return rows


def task(name, *pairs):
    subtasks = tuple(
        SubTask(instruction=text, goals=tuple(parse_goal(goal) for goal in goals))
        for text, *goals in pairs
    )
    return Task(
        id=name,
        kind="complex" if name == "t2" else "simple",
        scene=SceneRef.of("kitchen_1"),
        subtasks=subtasks,
    )


TASKS = {
    "t1": task(
        "t1",
        ("Put the apple away.", "INSIDE(Apple, Fridge)", "CLOSED(Fridge)"),
        (EVIL, "HOLDON(robot, Apple)"),
    ),
    "t2": task("t2", ("Look for the mug.", "HOLDON(robot, Mug)"), ("Bring it.", "ON(Mug, Sink)")),
}
ANSWERS = {
    "t1": [AWAY, BACK],
    "t2": [MUG, POURED, POURED, POURED],  # then the script has run out
    "s4": [AWAY, DISC, BACK, DISC],
}


def sequence(name, *parts):
    """Return a sequence in the kitchen and the bedroom: each part is a room, words and goals."""
    subtasks = tuple(
        SubTask(
            instruction=words,
            whole=words,
            scene=SceneRef.of(scene),
            goals=tuple(map(parse_goal, goals)),
        )
        for scene, words, *goals in parts
    )
    return Task(id=name, kind="sequence", scene=SceneRef.of("kitchen_1"), subtasks=subtasks)


FRIDGE = (
    ("kitchen_1", "Open the fridge.", "OPEN(Fridge)"),
    ("kitchen_1", "Shut it.", "CLOSED(Fridge)"),
)
PEN = (
    ("bedroom_1", "Fetch the pen.", "HOLDON(robot, Pen)"),
    ("bedroom_1", "Put the pen on the bed.", "ON(Pen, Bed)"),
)
TASKS["s4"] = sequence(
    "s4",
    ("kitchen_1", "Put the apple away.", "INSIDE(Apple, Fridge)"),
    ("bedroom_1", "Fetch the disc.", "HOLDON(robot, CD)"),
    ("kitchen_1", "Fetch the apple.", "HOLDON(robot, Apple)"),
    ("bedroom_1", "Put the disc on the bed.", "ON(CD, Bed)"),
)
TASKS["s16"] = sequence("s16", *4 * (*FRIDGE, *PEN))


def make_run(folder, keys=KEYS):
    """Write the run of some episodes into a folder and return it."""
    files = RunFolder(folder, steps=True)
    header = Header(
        name="small <i>run</i>", options={"rows": []}, files={"tasks": "t" * 64},
        versions={"karma": "0"}, models={"planner": "scripted"}, steps=True,
    )  # fmt: skip
    files.claim(header, fix="")
    for row, name, seed in keys:
        world = Home(EmbeddedWorld) if len(TASKS[name].scenes) > 1 else EmbeddedWorld()
        steps, times = StepLog(), TimeLog()
        record = run_episode(
            _method(row, name, folder), world, TASKS[name],
            row=row, seed=seed, folder=folder, steps=steps, times=times,
        )  # fmt: skip
        files.commit(Finished(record=record, timing=times.of(record), steps=steps.data()))
    files.finish(keys, lambda records: {RESULTS: added_up(records)})
    return folder


def _method(row, name, folder):
    if row == EXPERT:
        return ExpertMethod()
    return KarmaMethod(
        Planner(ScriptedModel(ANSWERS[name]), "compact"), CosineRecall(Words()), MetadataVision(),
        KarmaSettings(policy="fifo-merge[2]"), maps=folder / "maps", attempts=1,
    )  # fmt: skip
